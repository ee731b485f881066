"""Writers of other programs' formats, each in that format's own conventions, for the tests of the readers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from cartier.contracts import Recording
from synthetic import RoomRecording, render

Y_UP_FROM_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""ARKit's and ARCore's world, y up, from ours; the floor stays at 0."""
OPTICAL_FROM_GL = np.diag([1.0, -1, -1, 1])


def save_depth(path: Path, depth_m: np.ndarray, per_metre: float = 1000.0) -> None:
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(np.rint(np.nan_to_num(depth_m) * per_metre).astype(np.uint16)).save(path)


def save_colour(path: Path, rgb: np.ndarray) -> None:
    path.parent.mkdir(exist_ok=True)
    Image.fromarray(rgb).save(path, quality=95)


def pose_row(pose: np.ndarray) -> list[float]:
    """x y z qx qy qz qw."""
    return [*pose[:3, 3].tolist(), *Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()]


def write_tum(recording: Recording, root: Path, name: str = "png") -> None:
    """Colour and depth at times of their own, the ground truth at 100 Hz through the poses at the colour's times."""
    root.mkdir()
    lists: dict[str, list[str]] = {"rgb": ["# color images"], "depth": ["# depth maps"], "groundtruth": ["# t x y z q"]}
    for i in range(len(recording)):
        frame, t = recording[i], 1305031102.175304 + i / 10
        lists["rgb"].append(f"{t:.6f} rgb/{t:.6f}.{name}")
        save_colour(root / "rgb" / f"{t:.6f}.{name}", frame.rgb)
        if frame.depth_m is not None:
            lists["depth"].append(f"{t + 0.01:.6f} depth/{t + 0.01:.6f}.png")
            save_depth(root / "depth" / f"{t + 0.01:.6f}.png", frame.depth_m, 5000)
        row = " ".join(repr(v) for v in pose_row(frame.world_from_camera))
        lists["groundtruth"] += [f"{t - 0.005:.6f} {row}", f"{t + 0.005:.6f} {row}"]
    for kind, lines in lists.items():
        if len(lines) > 1:
            (root / f"{kind}.txt").write_text("\n".join(lines) + "\n")
    c = recording.camera
    (root / "calibration.txt").write_text(f"{c.fx} {c.fy} {c.cx} {c.cy}\n")


def write_scannet(recording: Recording, root: Path) -> None:
    root.mkdir()
    for name in ("intrinsic", "pose"):
        (root / name).mkdir()
    for i in range(len(recording)):
        frame = recording[i]
        save_colour(root / f"color/{i * 10}.jpg", frame.rgb)
        if frame.depth_m is not None:
            save_depth(root / f"depth/{i * 10}.png", frame.depth_m)
        np.savetxt(root / f"pose/{i * 10}.txt", frame.world_from_camera)
    c = recording.camera
    matrix = [[c.fx, 0, c.cx, 0], [0, c.fy, c.cy, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    for kind in ("color", "depth"):
        np.savetxt(root / f"intrinsic/intrinsic_{kind}.txt", matrix)


def write_replica(recording: Recording, root: Path) -> None:
    root.mkdir()
    c, lines = recording.camera, []
    for i in range(len(recording)):
        frame = recording[i]
        save_colour(root / f"results/frame{i:06d}.jpg", frame.rgb)
        if frame.depth_m is not None:
            save_depth(root / f"results/depth{i:06d}.png", frame.depth_m, 6553.5)
        lines.append(" ".join(f"{v:.18e}" for v in frame.world_from_camera.ravel()))
    (root / "traj.txt").write_text("\n".join(lines))
    camera = {"w": c.width, "h": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy, "scale": 6553.5}
    (root / "cam_params.json").write_text(json.dumps({"camera": camera}))


def write_nerfstudio(recording: Recording, root: Path) -> None:
    """Intrinsics once for all; pixel (0, 0) is the corner of the first pixel."""
    root.mkdir()
    c, frames = recording.camera, []
    for i in range(len(recording)):
        view = recording[i]
        item = {"file_path": f"images/frame_{i + 1:05d}.png"}
        save_colour(root / item["file_path"], view.rgb)
        if view.depth_m is not None:
            item["depth_file_path"] = f"depth/frame_{i + 1:05d}.png"
            save_depth(root / item["depth_file_path"], view.depth_m)
        frames.append({**item, "transform_matrix": (view.world_from_camera @ OPTICAL_FROM_GL).tolist()})
    head = {"camera_model": "OPENCV", "w": c.width, "h": c.height, "fl_x": c.fx, "fl_y": c.fy}
    head |= {"cx": c.cx + 0.5, "cy": c.cy + 0.5, "k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0}
    (root / "transforms.json").write_text(json.dumps({**head, "frames": frames}))


def small_depth(recording: RoomRecording, i: int, by: int = 2) -> np.ndarray:
    """What a LiDAR of fewer pixels sees of the room."""
    c = recording.camera
    return render(recording.poses[i], c.scaled(c.width // by, c.height // by), recording.objects)[0]


def write_stray(recording: RoomRecording, root: Path, video: bool = False) -> None:
    """Poses of the optical frame in a world with y up; depth of half the size, all of confidence 2."""
    root.mkdir()
    lines, rgbs = ["timestamp, frame, x, y, z, qx, qy, qz, qw"], []
    for i in range(len(recording)):
        frame = recording[i]
        rgbs.append(frame.rgb)
        if not video:
            save_colour(root / f"rgb/{i:06d}.png", frame.rgb)
        if recording.with_depth:
            depth = small_depth(recording, i)
            save_depth(root / f"depth/{i:06d}.png", depth)
            (root / "confidence").mkdir(exist_ok=True)
            Image.fromarray(np.full(depth.shape, 2, np.uint8)).save(root / f"confidence/{i:06d}.png")
        row = pose_row(Y_UP_FROM_WORLD @ frame.world_from_camera)
        lines.append(f"{frame.time_s}, {i:06d}, " + ", ".join(map(repr, row)))
    (root / "odometry.csv").write_text("\n".join(lines) + "\n")
    c = recording.camera
    (root / "camera_matrix.csv").write_text(f"{c.fx}, 0.0, {c.cx}\n0.0, {c.fy}, {c.cy}\n0.0, 0.0, 1.0\n")
    if video:
        write_video(root / "rgb.mp4", rgbs)


def write_video(path: Path, rgbs: list[np.ndarray]) -> None:
    av = pytest.importorskip("av", reason="a video needs PyAV")
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.height, stream.width = rgbs[0].shape[:2]
        stream.pix_fmt, stream.bit_rate, stream.gop_size = "yuv420p", 20_000_000, 5
        for rgb in rgbs:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        container.mux(stream.encode())


def record3d_head(recording: RoomRecording) -> dict[str, object]:
    c, poses = recording.camera, []
    for pose in recording.poses:
        x, y, z, *quaternion = pose_row(Y_UP_FROM_WORLD @ pose @ OPTICAL_FROM_GL)
        poses.append([*quaternion, x, y, z])
    k = [c.fx, 0, 0, 0, c.fy, 0, c.cx, c.cy, 1]  # column by column
    sizes = {"w": c.width, "h": c.height, "dw": c.width // 2, "dh": c.height // 2}
    times = [i / 10 for i in range(len(poses))]
    return {"poses": poses, "K": k, "fps": 10, "frameTimestamps": times, **sizes}


def write_record3d(recording: RoomRecording, root: Path) -> None:
    """What a .r3d holds, unpacked; without LZFSE there is no depth in it."""
    root.mkdir()
    for i in range(len(recording)):
        save_colour(root / f"rgbd/{i}.jpg", recording[i].rgb)
        if recording.with_depth:
            lzfse = pytest.importorskip("liblzfse", reason="a .r3d's depth needs pyliblzfse")
            depth = small_depth(recording, i)
            (root / f"rgbd/{i}.depth").write_bytes(lzfse.compress(depth.tobytes()))
            (root / f"rgbd/{i}.conf").write_bytes(lzfse.compress(np.full(depth.shape, 2, np.uint8).tobytes()))
    (root / "metadata").write_text(json.dumps(record3d_head(recording)))


def write_record3d_export(recording: RoomRecording, root: Path) -> None:
    """The app's "EXR + JPG sequence"."""
    exr = pytest.importorskip("OpenEXR", reason="Record3D's export needs OpenEXR")
    root.mkdir()
    (root / "depth").mkdir()
    for i in range(len(recording)):
        save_colour(root / f"rgb/{i}.jpg", recording[i].rgb)
        exr.File({}, {"R": small_depth(recording, i)}).write(str(root / f"depth/{i}.exr"))
    (root / "metadata.json").write_text(json.dumps(record3d_head(recording)))


def write_arcore(recording: RoomRecording, root: Path) -> None:
    root.mkdir()
    lines = ["timestamp_ns,tx,ty,tz,qx,qy,qz,qw"]
    for i in range(len(recording)):
        frame, time = recording[i], 1_700_000_000_123_456_789 + i * 33_333_333
        save_colour(root / f"images/{time}.jpg", frame.rgb)
        if recording.with_depth:
            depth = small_depth(recording, i)
            save_depth(root / f"depth/{time}.png", depth)
            (root / "confidence").mkdir(exist_ok=True)
            Image.fromarray(np.full(depth.shape, 255, np.uint8)).save(root / f"confidence/{time}.png")
        row = pose_row(Y_UP_FROM_WORLD @ frame.world_from_camera @ OPTICAL_FROM_GL)
        lines.append(f"{time}," + ",".join(map(repr, row)))
    (root / "poses.csv").write_text("\n".join(lines) + "\n")
    c = recording.camera
    head = {"width": c.width, "height": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
    (root / "intrinsics.json").write_text(json.dumps(head))
