"""Corrections out of ROS messages: paths, RTAB-Map's graphs, and jumps of the transform above odometry."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import FRAME, OPTICAL, START_NS, BagFile, write_images

from cartier.errors import InputError
from cartier.geometry import invert
from cartier.live.sent_poses import SentPoses
from cartier.sources import open_source
from cartier.types.streams import PoseUpdate, Stamped
from cartier_ros.bags.graphs import GRAPH, LINK, MAP_DATA, MAP_GRAPH, PATH, read_graph
from synthetic import walk

pytest.importorskip("rosbags", reason="needs cartier[ros]")
WALK = walk()
POSES = [np.array(pose) for pose in WALK.poses]
LOOP = 14  # the frame at which the loop is closed
NODE = "int32 id\nint32 map_id\nint32 weight\nfloat64 stamp\nstring label\ngeometry_msgs/Pose pose\nuint8[] pixels"


def motion(turn_rad: float, x: float, y: float) -> np.ndarray:
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    moved = np.eye(4)
    moved[:2] = (c, -s, 0, x), (s, c, 0, y)
    return moved


def drifted(number: int) -> np.ndarray:
    """Drift of odometry: it grows until the loop is closed, and then no more."""
    share = min(number, LOOP) / LOOP
    return motion(-0.12 * share, 0.4 * share, -0.3 * share)


def ns(number: int) -> int:
    return START_NS + number * 10**8


def stamp(number: int) -> int:
    """That of a colour image."""
    return ns(number)


def base(number: int) -> np.ndarray:
    return np.asarray(POSES[number] @ invert(OPTICAL))


def path(m: Any, upto: int, poses: Callable[[int], np.ndarray] = base) -> Any:
    told = [
        m("geometry_msgs/msg/PoseStamped", m.header(stamp(k), "map"), m.pose(poses(k))) for k in range(0, upto + 1, 2)
    ]
    return m(PATH, m.header(stamp(upto), "map"), told)


def graph(m: Any, upto: int) -> Any:
    pose = np.eye(4)
    transform = m._transform(0, "map", "odom", pose).transform
    numbers = list(range(0, upto + 1, 2))
    ids = np.array([k + 1 for k in numbers], np.int32)
    link = m("rtabmap_msgs/msg/Link", 1, 3, 0, transform, np.zeros(36))
    return m(MAP_GRAPH, m.header(stamp(upto), "map"), transform, ids, [m.pose(base(k)) for k in numbers], [link])


def with_types(bag: BagFile) -> Any:
    from rosbags.typesys import get_types_from_msg

    for name, text in (
        ("rtabmap_msgs/msg/Link", LINK), (MAP_GRAPH, GRAPH), ("rtabmap_msgs/msg/Node", NODE),
        (MAP_DATA, "std_msgs/Header header\nrtabmap_msgs/MapGraph graph\nrtabmap_msgs/Node[] nodes"),
    ):  # fmt: skip
        bag.messages.store.register(get_types_from_msg(text, name))
    return bag.messages


def write(folder: Path, tell: Callable[[BagFile, Any, int], None], kind: str = "mcap", jumps: bool = True) -> Path:
    """A robot whose odometry drifts until a loop is closed; ``tell`` publishes after each frame."""
    with BagFile(folder, kind) as bag:
        m = with_types(bag)
        write_images(bag, WALK)
        bag.put("/tf_static", START_NS, m.transforms((START_NS, "base_link", FRAME, OPTICAL)))
        above = np.eye(4)
        for k in range(len(WALK)):
            if jumps and k > LOOP:
                above = invert(drifted(k))
            bag.put("/tf", ns(k), m.transforms((ns(k), "odom", "base_link", drifted(k) @ base(k))))
            bag.put("/tf", ns(k), m.transforms((ns(k), "map", "odom", above)))
            tell(bag, m, k)
    return folder


def played(folder: Path) -> tuple[dict[int, np.ndarray], SentPoses, list[PoseUpdate]]:
    """The frames as sent, what is known of them in the end, and the updates."""
    sent, poses, updates = {}, SentPoses(), []
    for event in open_source(f"bag:{folder}@max"):
        if isinstance(event, Stamped):
            sent[event.stamp_ns] = event.frame.world_from_camera
            poses.add(event.stamp_ns, event.frame.world_from_camera)
        elif isinstance(event, PoseUpdate):
            updates.append(event)
            poses.correct(event.poses)
    return sent, poses, updates


def right(sent: dict[int, np.ndarray], poses: SentPoses, off_m: float = 0.012) -> bool:
    """Whether all poses are right in the end; those between named frames are blended."""
    assert len(sent) >= len(WALK) - 2
    numbers = {ns: round((ns - START_NS) / 1e8) for ns in sent}
    return all(np.abs(poses.pose(ns, pose) - POSES[numbers[ns]]).max() < off_m for ns, pose in sent.items())


def tell_path(bag: BagFile, m: Any, k: int) -> None:
    if k > LOOP and k % 2 == 0:
        bag.put("/mapPath", ns(k) + 6 * 10**7, path(m, k))


def tell_graph(bag: BagFile, m: Any, k: int) -> None:
    if k % 2:
        return
    if k <= LOOP:  # the stamps of nodes are told while they are new
        node = m("rtabmap_msgs/msg/Node", k + 1, 0, 0, stamp(k) / 1e9, "", m.pose(np.eye(4)), np.zeros(99, np.uint8))
        empty = m(MAP_GRAPH, m.header(stamp(k), "map"), graph(m, 0).map_to_odom, np.zeros(0, np.int32), [], [])
        bag.put("/mapData", ns(k) + 6 * 10**7, m(MAP_DATA, m.header(stamp(k), "map"), empty, [node]))
    else:
        bag.put("/mapGraph", ns(k) + 6 * 10**7, graph(m, k))


@pytest.mark.parametrize("kind", ["mcap", "ros1"])
@pytest.mark.parametrize("tell", [tell_path, tell_graph])
def test_optimised_poses_correct_what_was_sent(tell: Any, kind: str, tmp_path: Path) -> None:
    sent, poses, updates = played(write(tmp_path / "bag", tell, kind))
    assert not right(sent, SentPoses())
    assert [u.origin for u in updates][-1] == ("/mapPath" if tell is tell_path else "/mapGraph")
    assert right(sent, poses)


def test_a_path_of_the_camera_is_told_from_one_of_the_base(tmp_path: Path) -> None:
    def tell(bag: BagFile, m: Any, k: int) -> None:
        if k > LOOP and k % 2 == 0:
            bag.put("/keyframes", ns(k) + 6 * 10**7, path(m, k, lambda number: POSES[number]))

    sent, poses, _ = played(write(tmp_path / "bag", tell))
    assert right(sent, poses)


def test_a_path_that_fits_nothing_is_passed_over(tmp_path: Path) -> None:
    def tell(bag: BagFile, m: Any, k: int) -> None:
        if k > LOOP:  # a plan: of another place, and of a robot that turns otherwise
            bag.put("/plan", ns(k), path(m, k, lambda number: motion(0.7 * number, 3.0 * number, 1.0)))

    _, _, updates = played(write(tmp_path / "bag", tell, jumps=False))
    assert not updates


def test_a_path_in_another_world_is_passed_over(tmp_path: Path) -> None:
    def tell(bag: BagFile, m: Any, k: int) -> None:
        told = path(m, k)
        told.header.frame_id = "elsewhere"
        bag.put("/mapPath", ns(k) + 6 * 10**7, told)

    _, _, updates = played(write(tmp_path / "bag", tell, jumps=False))
    assert not updates


def test_a_jump_is_spread_over_the_way(tmp_path: Path) -> None:
    sent, poses, updates = played(write(tmp_path / "bag", lambda bag, m, k: None))
    (update,) = updates
    assert "guess" in update.origin
    before = max(np.linalg.norm(pose[:3, 3] - POSES[round((ns - START_NS) / 1e8)][:3, 3]) for ns, pose in sent.items())
    after = max(
        np.linalg.norm((poses.pose(ns, pose) - POSES[round((ns - START_NS) / 1e8)])[:3, 3]) for ns, pose in sent.items()
    )
    assert before > 0.45 and after < 0.12, "drift grew by time, and is spread by the way"
    first, last = min(sent), max(sent)
    np.testing.assert_allclose(poses.pose(first, sent[first]), POSES[0], atol=1e-6)
    assert poses.pose(last, sent[last]) is sent[last]


def test_steady_transforms_correct_nothing(tmp_path: Path) -> None:
    _, _, updates = played(write(tmp_path / "bag", lambda bag, m, k: None, jumps=False))
    assert not updates


def test_damaged_graphs_are_refused(tmp_path: Path) -> None:
    with BagFile(tmp_path / "bag") as bag:
        m = with_types(bag)
        whole = m.bytes_of(graph(m, 6))
    assert len(read_graph(whole, MAP_GRAPH, "cdr", "it").poses) == 4
    for cut in (3, 20, 60, len(whole) - 400):
        with pytest.raises(InputError, match="it is damaged"):
            read_graph(whole[:cut], MAP_GRAPH, "cdr", "it")
    bad = graph(m, 6)
    bad.poses_id = bad.poses_id[:2]
    with pytest.raises(InputError, match="2 nodes and 4 poses"):
        read_graph(m.bytes_of(bad), MAP_GRAPH, "cdr", "it")
    nan = graph(m, 6)
    nan.poses[1].position.x = float("nan")
    with pytest.raises(InputError, match="NaN"):
        read_graph(m.bytes_of(nan), MAP_GRAPH, "cdr", "it")
