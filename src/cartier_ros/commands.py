"""Command that plays a bag or a simulated robot on ROS 2 topics: play."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Annotated, Any

import typer

from cartier.cli.common import missing, progress, say
from cartier.errors import InputError

app = typer.Typer()


@app.command()
def play(
    played: Annotated[
        str,
        typer.Argument(
            metavar="WHAT", help="A ROS 1 or ROS 2 bag (.bag, .mcap, .db3, or its folder), or dollhouse:HOME, a robot."
        ),
    ],
    ros: Annotated[bool, typer.Option("--ros", help="On ROS 2 topics: the default, and the only way.")] = True,
    speed: Annotated[float, typer.Option(help="Of a bag: how many seconds of it pass in a second.")] = 1.0,
    domain: Annotated[int | None, typer.Option(help="The DDS domain. Default: ROS_DOMAIN_ID, else 0.")] = None,
    explore: Annotated[
        bool, typer.Option("--explore", help="Of a robot: it explores by itself until it is sent somewhere.")
    ] = False,
    seed: Annotated[int, typer.Option(help="Of a robot: of its odometry's errors and its exploration.")] = 0,
) -> None:
    """Play a bag, or a simulated robot with Nav2, on real ROS 2 topics over DDS, without ROS.

    A bag begins when somebody listens. A robot has a camera, transforms, odometry and the action /navigate_to_pose.
    Ctrl-C ends it.
    """
    world, _, home = played.partition(":")
    if world == "dollhouse" and home:
        if speed != 1:
            raise InputError("--speed is for bags: a robot drives as fast as it drives")
        _robot(home, domain, explore, seed)
        return
    if explore or seed:
        raise InputError("--explore and --seed are for a robot, such as dollhouse:studio, and not for bags")
    _bag(Path(played), speed, domain)


def _robot(home: str, domain: int | None, explore: bool, seed: int) -> None:
    from cartier import plugins
    from cartier_ros.dds.domain import domain_of

    number = domain_of(domain, "play")
    scene = plugins.make("worlds", "dollhouse").scene(home)  # type: ignore[attr-defined]
    try:
        from cartier_ros.robots.played import PlayedRobot

        robot = PlayedRobot(scene, number, seed, explore)
    except ModuleNotFoundError as error:
        raise missing("ros", error) from error
    for ending in (signal.SIGINT, signal.SIGTERM):
        signal.signal(ending, lambda *_: robot.close())
    say(f"domain {number}: a simulated robot in {scene.name} serves /navigate_to_pose; Ctrl-C ends it")
    robot.run()
    x, y, yaw = robot.pose
    print(f"{robot.frames} images; the robot stands at x {x:.3f} y {y:.3f} m yaw {yaw:.3f} rad")


def _bag(bag: Path, speed: float, domain: int | None) -> None:
    from cartier_ros.dds.domain import domain_of
    from cartier_ros.rosbag import matches

    if not matches(bag):
        raise InputError(f"{bag} is no ROS bag: a .bag, .mcap or .db3 file, or a folder of them")
    if not speed > 0:
        raise InputError(f"--speed must be above 0, got {speed:g}")
    number = domain_of(domain, "play")
    try:
        from cartier_ros.bags.bag import Bag
        from cartier_ros.streams.topic_player import TopicPlayer

        player = TopicPlayer(Bag(bag), number, speed)
    except ModuleNotFoundError as error:
        raise missing("ros", error) from error
    signal.signal(signal.SIGINT, lambda *_: player.close())
    for name in player.left_out:
        say(f"not played: {name}")
    say(f"domain {number}: waiting for somebody who listens to the images; Ctrl-C ends it")
    _told(player.wait(), player)


def _told(listeners: int, player: Any) -> None:
    if not listeners:
        raise InputError("nobody listened, and nothing was played")
    with progress("playing") as step:
        sent = player.play(step)
    if player.damaged:
        say(f"{len(player.damaged)} messages were not played; the first: {player.damaged[0]}")
    for name, count in sorted(sent.items()):
        print(f"{name}: {count} messages")
