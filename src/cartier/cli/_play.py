"""Command that plays a bag on ROS 2 topics: play."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Annotated, Any

import typer

from cartier.cli._common import missing, progress, say
from cartier.errors import InputError

app = typer.Typer()


@app.command()
def play(
    bag: Annotated[
        Path, typer.Argument(metavar="BAG", help="A ROS 1 or ROS 2 bag (.bag, .mcap, .db3, or its folder).")
    ],
    speed: Annotated[float, typer.Option(help="How many seconds of the bag pass in a second.")] = 1.0,
    domain: Annotated[int | None, typer.Option(help="The DDS domain. Default: ROS_DOMAIN_ID, else 0.")] = None,
) -> None:
    """Play a bag on real ROS 2 topics over DDS, without ROS: images, CameraInfo, transforms and poses.

    It begins when somebody listens. Ctrl-C ends it.
    """
    from cartier.dds.domain import domain_of
    from cartier.recordings.rosbag import matches

    if not matches(bag):
        raise InputError(f"{bag} is no ROS bag: a .bag, .mcap or .db3 file, or a folder of them")
    if not speed > 0:
        raise InputError(f"--speed must be above 0, got {speed:g}")
    number = domain_of(domain, "play")
    try:
        from cartier.recordings.ros.bags import Bag
        from cartier.sources.common.topic_player import TopicPlayer

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
