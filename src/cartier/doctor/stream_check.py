"""Check of a stream before it is mapped: rates, pairing, delays, lens, depth, poses; each fault with its mend.

The frames that are kept, bounded in number, are examined as ``cartier doctor`` examines a recording.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from cartier.contracts import Source, SourceDefaults, optional
from cartier.doctor import Fault as DoctorFault
from cartier.doctor import Report, checks, examine
from cartier.doctor._consistency import turns_deg
from cartier.doctor.explanation import explained
from cartier.doctor.pictures import picture_faults, pictures_change
from cartier.errors import brief, frame_number
from cartier.mapping.samples import sample
from cartier.types import Camera, Frame, TrueObject
from cartier.types.streams import REASONS, Fault, Stamped

SECONDS = 10.0
KEPT = 48  # frames in memory, spread over the whole time
LEFT_OUT = 0.2  # from this share on, a reason is a fault
SLOW_HZ = 1.0  # below it, frames overlap too little to be compared
OLD_S = 1.0  # behind it, a robot has moved on
SAME_CLOCK_S = 86_400.0  # stamps farther off are of a recording, or of a simulation's clock
STILL_M, STILL_DEG = 0.02, 1.0
LEAP_M, LEAP_DEG = 0.25, 15.0  # what a pose may be off
FAST_M_S, FAST_DEG_S, TIMES = 1.0, 90.0, 3.0  # a step that is slower is none, nor one that is so often the usual speed
MENDS = {
    "silent": "start the driver, or name its topics",
    "no_depth": "switch on the driver's synchronisation of depth and colour, and record both at the same rate",
    "no_pose": "publish the transforms before the images, at 20 Hz or more, by the same clock",
    "too_early": "start the transforms before the camera",
    "pose_gap": "publish the moving transforms at 20 Hz or more",
    "pose_jump": "stop the second program that publishes the same transform, or map in 'odom'",
    "circle": "find the program that publishes this transform: ros2 topic info -v /tf; nobody needs it",
    "frame": "name the frame to map in: --frame map, and start the localisation before the check",
    "two_parents": "stop one of the two programs that publish this frame",
    "double": "stop the second publisher of this topic",
    "late": "stop the second publisher of this topic",
    "clock": "set use_sim_time for all nodes or for none, and synchronise the computers' clocks (chrony)",
    "unreadable": "mend what the line says",
    "lost": "raise net.core.rmem_max, or send smaller images",
    "busy": "send smaller images, or fewer",
    "ended": "let the program send until it is stopped",
}
DRIVER_MENDS = {  # of what the examination of a recording finds, where a driver can be mended instead of a file
    "opengl_axes": "let the images' frame_id name the optical frame (x right, y down, z forward), and publish it",
    "inverted_poses": "publish the pose of the robot in its parent frame, not the inverse",
    "not_level": "publish frames with z up (REP 103), and the camera's mount as it is",
    "time_offset": "stamp images and transforms by one clock, at the time of exposure",
    "depth_not_registered": "switch on the driver's registration, which publishes depth aligned to colour",
    "depth_scale": "publish depth as 16UC1 in millimetres, or as 32FC1 in metres",
    "pose_scale": "publish transforms in metres",
    "intrinsics_resolution": "publish the CameraInfo of this image: the same camera, resolution and crop",
}
FEW_VIEWS = "too_few_views"


@dataclass(frozen=True)
class StreamReport:
    """What a check of a stream found.

    Args:
        name: The source.
        seconds: How long it was watched (s).
        frames: How many frames came with their pose.
        sound: One line for each thing that is as it should be.
        faults: What is wrong, and how to mend it.
        notes: What could not be judged.
    """

    name: str
    seconds: float
    frames: int
    sound: tuple[str, ...] = ()
    faults: tuple[DoctorFault, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.faults

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values.

        Returns:
            ``ok`` and all fields by name.
        """
        return {"ok": self.ok} | asdict(self) | {"faults": [fault.to_dict() for fault in self.faults]}


@dataclass
class _Watched:
    """What came in: some of the frames, spread over the time, and what was said of the others."""

    frames: list[Frame] = field(default_factory=list)
    stamps_ns: list[int] = field(default_factory=list)
    ages_s: list[float] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    left_out: Counter[str] = field(default_factory=Counter)
    texts: dict[str, str] = field(default_factory=dict)
    every: int = 1
    last: Stamped | None = None
    moved: bool = False
    steps: list[tuple[float, float, float]] = field(default_factory=list)
    """How far the camera moved (m), how far it turned (degrees) and how long that took (s)."""

    def add(self, event: Any) -> None:
        if isinstance(event, Stamped):
            if self.moved:  # poses of before are in another frame
                self.frames, self.last, self.moved = [], None, False
            if len(self.stamps_ns) % self.every == 0 or not self.frames:
                self.frames.append(event.frame)
            if len(self.frames) > KEPT:
                self.frames, self.every = self.frames[::2], self.every * 2
            self.stamps_ns.append(event.stamp_ns)
            self._step(event)
            received_s = time.time() - (time.monotonic() - event.received_s)
            self.ages_s.append(received_s - event.stamp_ns / 1e9)
        elif isinstance(event, Fault):
            self.counts[event.reason] += 1
            self.moved |= event.reason == "frame"
            self.left_out[event.reason] += event.frames
            if event.reason == "silent":  # the last one: at first nobody may have been there
                self.texts[event.reason] = event.text
            self.texts.setdefault(event.reason, event.text)

    def _step(self, event: Stamped) -> None:
        if self.last is not None:
            a, b = self.last.frame.world_from_camera, event.frame.world_from_camera
            took_s = max((event.stamp_ns - self.last.stamp_ns) / 1e9, 1e-3)
            self.steps.append(
                (float(np.linalg.norm(b[:3, 3] - a[:3, 3])), float(turns_deg(a[:3, :3].T @ b[:3, :3])), took_s)
            )
        self.last = event

    def leaps(self) -> list[tuple[float, float]]:
        """Steps (m, degrees) that no robot makes which moves as this one does otherwise."""
        if not self.steps:
            return []
        way_m, turn_deg, took_s = np.array(self.steps).T
        fast_m_s, fast_deg_s = (
            max(TIMES * float(np.median(moved / took_s)), least)
            for moved, least in ((way_m, FAST_M_S), (turn_deg, FAST_DEG_S))
        )
        far = (way_m > LEAP_M + fast_m_s * took_s) | (turn_deg > LEAP_DEG + fast_deg_s * took_s)
        return list(zip(way_m[far].tolist(), turn_deg[far].tolist(), strict=True))


class _Kept:
    """The kept frames as a recording."""

    truth: Sequence[TrueObject] | None = None

    def __init__(self, source: Source, frames: Sequence[Frame]) -> None:
        self.name, self._frames = source.name, frames
        self.notes: Sequence[str] = optional(source, SourceDefaults, "notes")
        self.camera: Camera = frames[0].camera

    def __len__(self) -> int:
        return len(self._frames)

    def __getitem__(self, index: int) -> Frame:
        return self._frames[frame_number(index, len(self), self.name)]

    def fingerprint(self) -> str:
        return "kept in memory"


def check_stream(
    source: Source, seconds: float = SECONDS, progress: Callable[[int, int], None] | None = None
) -> StreamReport:
    """Watch a source and say whether its stream can be mapped; nothing is written.

    Args:
        source: The source; it is closed afterwards.
        seconds: How long to watch (s); it ends earlier if the stream ends.
        progress: Called with the tenths of seconds that have passed, and of all.

    Returns:
        The report.

    Raises:
        CartierError: Nothing can be listened to.
    """
    watched, begin = _Watched(), time.monotonic()
    try:
        for event in source:
            watched.add(event)
            passed_s = time.monotonic() - begin
            if progress is not None:
                progress(int(min(passed_s, seconds) * 10), int(seconds * 10))
            if passed_s >= seconds:
                break
    finally:
        source.close()
    took_s = round(time.monotonic() - begin, 1)
    faults = _left_out(watched)
    if not watched.stamps_ns:
        if not faults:
            why = watched.texts.get("silent", "the stream ended without a frame")
            faults = [DoctorFault("silent", why, MENDS["silent"])]
        return StreamReport(source.name, took_s, 0, (), tuple(faults))
    sound, notes = list[str](), [brief(note, 300) for note in optional(source, SourceDefaults, "notes")]
    played = optional(source, SourceDefaults, "recording") is not None
    pictures = list(picture_faults(watched.frames))
    faults += pictures
    sound += (
        [] if pictures else ["pictures  in colour, as bright as they should be, and their edges on those of the depth"]
    )
    for check in (_rate, _age, _lens, _depth):
        fault, line = check(watched)
        if fault is not None and check is _rate and played:  # a recording waits for nobody
            notes.append(fault.evidence)
            continue
        faults += [fault] if fault is not None else []
        sound += [line] if line and fault is None else []
    faults += _examined(source, watched, sound, notes)
    return StreamReport(source.name, took_s, len(watched.stamps_ns), tuple(sound), tuple(faults), tuple(notes))


def _left_out(watched: _Watched) -> list[DoctorFault]:
    """What the source said of itself, where it cost frames or came often."""
    came = len(watched.stamps_ns)
    all_frames = came + watched.left_out.total()
    faults = []
    for reason in watched.counts:
        lost, said = watched.left_out[reason], watched.counts[reason]
        if reason == "silent" and all_frames:
            continue
        always = reason in ("two_parents", "circle", "frame", "clock", "ended", "double")
        if not (lost > LEFT_OUT * all_frames or always or (said and not came)):
            continue
        share = f"{lost} of {all_frames} images left out: " if lost else ""
        evidence = f"{share}{REASONS[reason]}; {watched.texts[reason]}"
        faults.append(DoctorFault(reason, brief(evidence, 400), MENDS[reason]))
    return faults


def _rate(watched: _Watched) -> tuple[DoctorFault | None, str]:
    stamps_s = np.array(watched.stamps_ns) / 1e9
    if len(stamps_s) < 2 or stamps_s[-1] <= stamps_s[0]:
        return DoctorFault("rate", f"{len(stamps_s)} frame in all", "check the driver's rate"), ""
    hz = (len(stamps_s) - 1) / (stamps_s[-1] - stamps_s[0])
    if hz < SLOW_HZ:
        return DoctorFault("rate", f"{hz:.2f} frames a second: a moving robot skips places", "send 2 or more"), ""
    lost = watched.left_out.total()
    paired = len(stamps_s) / (len(stamps_s) + lost)
    return None, f"frames  {hz:.1f} a second by their stamps, {paired:.0%} of the images with depth and pose"


def _age(watched: _Watched) -> tuple[DoctorFault | None, str]:
    age_s = float(np.percentile(watched.ages_s, 25))  # the first ones waited until it was known what is mapped
    if abs(age_s) > SAME_CLOCK_S:
        return None, "clock   the stamps are those of a recording or of a simulation"
    if abs(age_s) <= OLD_S:
        return None, f"clock   frames are whole {age_s * 1000:.0f} ms after their stamps"
    how = "in the future" if age_s < 0 else "old"
    evidence = f"the stamps are {abs(age_s):.1f} s {how} by this computer's clock when a frame is whole"
    return DoctorFault("age", evidence, "synchronise the computers' clocks (chrony), or send smaller images"), ""


def _lens(watched: _Watched) -> tuple[DoctorFault | None, str]:
    fault, told = checks.lens(watched.frames[0].camera)
    if fault is not None:
        return replace(fault, repair=DRIVER_MENDS["intrinsics_resolution"]), ""
    return None, f"lens    {told}"


def _depth(watched: _Watched) -> tuple[DoctorFault | None, str]:
    maps = [frame.depth_m for frame in watched.frames if frame.depth_m is not None]
    if not maps:
        how = "record depth: without it there is no floor plan, and no goal pose"
        return DoctorFault("no_depth", "no frame has a depth image", how), ""
    known = np.concatenate([depth_m[::8, ::8].ravel() for depth_m in maps])
    share = float(np.isfinite(known).mean())
    if not share:
        return None, ""  # the examination says so
    median_m, far_m = np.nanpercentile(known, [50, 98])
    if (fault := checks.depth_unit(known)) is not None:
        return fault, ""
    return (
        None,
        f"depth   {share:.0%} of the pixels, half of them within {median_m:.1f} m, the farthest at {far_m:.1f} m",
    )


def _examined(source: Source, watched: _Watched, sound: list[str], notes: list[str]) -> list[DoctorFault]:
    """What the examination of the frames finds; a robot that stands still is no fault."""
    report = examine(_Kept(source, watched.frames))
    corrected = {"rotated_images"} | ({"not_level"} if _only_the_floor(report) else set())
    notes += [f"{fault.evidence}: the map corrects it" for fault in report.faults if fault.fault in corrected]
    faults = [
        replace(fault, repair=DRIVER_MENDS.get(fault.fault, fault.repair), fix="")
        for fault in report.faults
        if fault.fault not in (FEW_VIEWS, *corrected)
        and (fault.fault != "no_depth" or watched.frames[0].depth_m is not None)
    ]
    if (leaps := watched.leaps()) and "pose_jump" not in {fault.fault for fault in faults}:
        way_m, turn_deg = max(leaps)
        told = (
            f"the pose leaps {len(leaps)} times, once by {way_m:.2f} m and {turn_deg:.0f}°, faster than it moves else"
        )
        faults.append(DoctorFault("pose_jump", told, "wait until the localisation has settled, or map in 'odom'"))
    poses = np.array([frame.world_from_camera for frame in watched.frames])
    way_m = float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
    turns = np.swapaxes(poses[:-1, :3, :3], 1, 2) @ poses[1:, :3, :3]
    cosines = (np.trace(turns, axis1=1, axis2=2) - 1) / 2
    turned_deg = float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).sum())
    if way_m < STILL_M and turned_deg < STILL_DEG:
        if pictures_change(watched.frames):
            evidence = "the images change, and the pose of the camera does not"
            how = "publish the robot's motion: the transform from 'odom' to the robot, or --odometry"
            return [*faults, DoctorFault("still_pose", evidence, how)]
        notes.append("the robot stood still: poses and depth could not be compared; drive it during the check")
    else:
        sound.append(f"pose    the camera moved by {way_m:.1f} m and turned by {turned_deg:.0f}°")
    notes += [note for note in report.notes if "frames examined" not in note]
    if report.contradictory:
        how = "are depth, images and poses of the same camera, and by one clock?"
        why = explained(sample(_Kept(source, watched.frames)))
        evidence = f"the depth of frames that overlap disagrees{'; ' if why else ''}{why}"
        faults.append(DoctorFault("contradictory", evidence, how))
    if not faults and FEW_VIEWS not in {fault.fault for fault in report.faults}:
        sound.append("world   z is up, and frames that overlap agree")
    return faults


def _only_the_floor(report: Report) -> bool:
    """Whether z is up, so that levelling only moves the floor, and goals stay valid on the robot."""
    level = None if report.repair is None else report.repair.level
    return level is not None and np.array_equal(level[:3, :3], np.eye(3))
