"""Writers of other programs' formats, each in that format's own conventions, for the tests of the readers."""

from __future__ import annotations

import json
import sqlite3
import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from cartier.contracts import Recording
from cartier.geometry import invert
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
    matrix = np.array([[c.fx, 0, c.cx, 0], [0, c.fy, c.cy, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
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


def write_rtsm(recording: RoomRecording, root: Path) -> None:
    """A session of a phone: each message is JSON, JPEG, depth in mm and confidence, each after its length."""
    root.mkdir()
    index, messages = [], b""
    for i in range(len(recording)):
        frame, colour = recording[i], BytesIO()
        Image.fromarray(frame.rgb).save(colour, "JPEG", quality=95)
        pose, c = Y_UP_FROM_WORLD @ frame.world_from_camera @ OPTICAL_FROM_GL, recording.camera
        depth = np.rint(np.nan_to_num(small_depth(recording, i)) * 1000).astype("<u2")
        head = {
            "timestamp_ns": 10**12 + i * 10**8, "T_wc": pose.T.ravel().tolist(), "tracking_state": "normal",
            "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy, "intrinsics_width": c.width, "intrinsics_height": c.height,
            "rgb_width": c.width, "rgb_height": c.height, "depth_width": depth.shape[1], "depth_height": depth.shape[0],
            "rgb_format": "jpeg", "depth_format": "uint16_mm", "pose_format": "matrix4x4_col_major",
            "depth_scale": 0.001,
        }  # fmt: skip
        sure = np.full(depth.shape, 2, np.uint8)
        parts = (json.dumps(head).encode(), colour.getvalue(), depth.tobytes(), sure.tobytes())
        message = b"".join(struct.pack("<I", len(part)) + part for part in parts)
        index.append(json.dumps({"seq": i, "offset": len(messages), "length": len(message)}))
        messages += message
    (root / "messages.bin").write_bytes(messages)
    (root / "index.jsonl").write_text("\n".join(index) + "\n")


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


def write_polycam(recording: RoomRecording, root: Path, corrected: bool = False) -> None:
    """Raw data; where there are corrected cameras they are right, and the others off by half a metre."""
    root.mkdir()
    c, kinds = recording.camera, (("images", "cameras", 0.5), ("corrected_images", "corrected_cameras", 0.0))
    for i in range(len(recording)):
        frame, stem = recording[i], 638_443_502_000_000 + i * 100_000
        pose = Y_UP_FROM_WORLD @ frame.world_from_camera @ OPTICAL_FROM_GL
        for images, cameras, off in kinds if corrected else ((*kinds[0][:2], 0.0),):
            (root / "keyframes" / cameras).mkdir(parents=True, exist_ok=True)
            save_colour(root / f"keyframes/{images}/{stem}.jpg", frame.rgb)
            head = {f"t_{row}{column}": pose[row, column] for row in range(3) for column in range(4)}
            head |= {"t_03": pose[0, 3] + off, "width": c.width, "height": c.height, "blur_score": 115.28}
            head |= {"fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy, "timestamp": stem}
            (root / f"keyframes/{cameras}/{stem}.json").write_text(json.dumps(head))
        if recording.with_depth:
            depth = small_depth(recording, i)
            save_depth(root / f"keyframes/depth/{stem}.png", depth)
            (root / "keyframes/confidence").mkdir(exist_ok=True)
            Image.fromarray(np.full(depth.shape, 255, np.uint8)).save(root / f"keyframes/confidence/{stem}.png")


def write_scannerapp(recording: RoomRecording, root: Path, every: int = 1) -> None:
    """3D Scanner App's "All Data": depth for every frame, colour for one in ``every``."""
    root.mkdir()
    c = recording.camera
    for i in range(len(recording)):
        frame = recording[i]
        for number in range(every * i, every * (i + 1)):
            pose = Y_UP_FROM_WORLD @ frame.world_from_camera @ OPTICAL_FROM_GL
            head = {"cameraPoseARFrame": pose.ravel().tolist(), "time": number / 60, "frame_index": number}
            head |= {"intrinsics": [c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1], "motionQuality": 1}
            (root / f"frame_{number:05d}.json").write_text(json.dumps(head))
            if recording.with_depth:
                depth = small_depth(recording, i)
                save_depth(root / f"depth_{number:05d}.png", depth)
                Image.fromarray(np.full(depth.shape, 2, np.uint8)).save(root / f"conf_{number:05d}.png")
        save_colour(root / f"frame_{every * i:05d}.jpg", frame.rgb)


def write_colmap(recording: Recording, root: Path, binary: bool = True) -> None:
    """A sparse model in sparse/0 with two points in each image but the first; images/ beside it."""
    model = root / "sparse/0"
    model.mkdir(parents=True)
    c = recording.camera
    numbers = (c.fx, c.fy, c.cx + 0.5, c.cy + 0.5)
    packed, lines = [struct.pack("<Q", len(recording))], ["# Image list with two lines of data per image:"]
    for i in range(len(recording)):
        name, frame = f"frame_{i:05d}.png", recording[i]
        save_colour(root / "images" / name, frame.rgb)
        x, y, z, qx, qy, qz, qw = pose_row(invert(frame.world_from_camera))
        points = [] if i == 0 else [(1.5, 2.5, 7), (3.5, 4.5, -1)]
        packed.append(struct.pack("<I7dI", i + 1, qw, qx, qy, qz, x, y, z, 3) + name.encode() + b"\0")
        packed.append(struct.pack("<Q", len(points)) + b"".join(struct.pack("<2dq", *point) for point in points))
        lines.append(" ".join(map(repr, (i + 1, qw, qx, qy, qz, x, y, z, 3))) + f" {name}")
        lines.append(" ".join(f"{u} {v} {key}" for u, v, key in points))
    if binary:
        head = struct.pack("<QIiQQ4d", 1, 3, 1, c.width, c.height, *numbers)
        (model / "cameras.bin").write_bytes(head)
        (model / "images.bin").write_bytes(b"".join(packed))
    else:
        (model / "cameras.txt").write_text(
            f"# Camera list\n3 PINHOLE {c.width} {c.height} {' '.join(map(repr, numbers))}\n"
        )
        (model / "images.txt").write_text("\n".join(lines) + "\n")


BASE_FROM_OPTICAL = np.array([[0.0, 0, 1, 0.1], [-1, 0, 0, 0.02], [0, -1, 0, 1.2], [0, 0, 0, 1]])
"""RTAB-Map's local transform: a camera on a robot, 1.2 m up."""


def write_rtabmap(recording: Recording, root: Path, by_id: bool = True, camera_poses: bool = True) -> None:
    """``rtabmap-export --images_id --poses_camera --poses_format 11``, or with images by time, or poses of the base."""
    root.mkdir()
    (root / "home_calib").mkdir()
    c, lines = recording.camera, ["#timestamp x y z qx qy qz qw id"]
    for i in range(len(recording)):
        frame, time = recording[i], f"{1_700_000_000.25 + i / 10:f}"
        stem = str(7 + 3 * i) if by_id else time
        save_colour(root / f"home_rgb/{stem}.jpg", frame.rgb)
        if frame.depth_m is not None:
            save_depth(root / f"home_depth/{stem}.png", frame.depth_m)
        local = np.round(BASE_FROM_OPTICAL[:3], 6).ravel().tolist()
        (root / f"home_calib/{stem}.yaml").write_text(
            f"%YAML:1.0\n---\ncamera_name: home\nimage_width: {c.width}\nimage_height: {c.height}\n"
            f"camera_matrix:\n   rows: 3\n   cols: 3\n   data: [ {c.fx}, 0., {c.cx}, 0.,\n"
            f"       {c.fy}, {c.cy}, 0., 0., 1. ]\n"
            f"local_transform:\n   rows: 3\n   cols: 4\n   data: {local}\n"
        )
        pose = frame.world_from_camera if camera_poses else frame.world_from_camera @ invert(BASE_FROM_OPTICAL)
        lines.append(f"{time} " + " ".join(f"{v:.9f}" for v in pose_row(pose)) + f" {7 + 3 * i}")
    (root / f"home_{'camera_' if camera_poses else ''}poses.txt").write_text("\n".join(lines) + "\n")


def packed(values: np.ndarray) -> bytes:
    """A matrix as RTAB-Map compresses it: zlib, then rows, columns and OpenCV's type."""
    kind = {"int32": 4, "float32": 5}[str(values.dtype)]
    return zlib.compress(values.tobytes()) + struct.pack("<3i", 1, values.size, kind)


def rvl(image: np.ndarray) -> bytes:
    """A 16-bit depth image as RVL, nibble by nibble, as the paper writes it down."""
    nibbles: list[int] = []

    def put(value: int) -> None:
        while value > 7:
            nibbles.append(value & 7 | 8)
            value >>= 3
        nibbles.append(value)

    pixels, before, i = image.ravel().tolist(), 0, 0
    while i < len(pixels):
        zeros = next((n for n, v in enumerate(pixels[i:]) if v), len(pixels) - i)
        others = next((n for n, v in enumerate(pixels[i + zeros :]) if not v), len(pixels) - i - zeros)
        put(zeros)
        put(others)
        for value in pixels[i + zeros : i + zeros + others]:
            step, before = value - before, value
            put(2 * step if step >= 0 else -2 * step - 1)
        i += zeros + others
    nibbles += [0] * (-len(nibbles) % 8)
    words = [int("".join(f"{n:x}" for n in nibbles[i : i + 8]), 16) for i in range(0, len(nibbles), 8)]
    return struct.pack(f"<{len(words)}I", *words)


def write_rtabmap_database(recording: Recording, path: Path, optimised: bool = True, depth_as: str = "rvl") -> None:
    """A database as RTAB-Map writes it, with odometry that is off by a metre where the graph was optimised.

    ``depth_as`` is rvl, which newer versions write by default, png or float.
    """
    c, base = recording.camera, sqlite3.connect(path)
    base.executescript(
        "CREATE TABLE Node (id INTEGER NOT NULL, map_id INTEGER, stamp FLOAT, pose BLOB, PRIMARY KEY (id));"
        "CREATE TABLE Data (id INTEGER NOT NULL, image BLOB, depth BLOB, calibration BLOB, time_enter DATE, "
        "PRIMARY KEY (id));"
        "CREATE TABLE Admin (version TEXT, opt_ids BLOB, opt_poses BLOB);"
        "CREATE TRIGGER insert_Data_timeEnter AFTER INSERT ON Data BEGIN "
        "UPDATE Node SET map_id = 0 WHERE rowid = new.rowid; END; CREATE UNIQUE INDEX IDX_Node_id ON Node (id);"
    )
    head = struct.pack("<11i", 0, 21, 4, 0, c.width, c.height, 9, 5, 9, 12, 12)
    k, p = [c.fx, 0, c.cx, 0, c.fy, c.cy, 0, 0, 1], [c.fx, 0, c.cx, 0, 0, c.fy, c.cy, 0, 0, 0, 1, 0]
    local = struct.pack("<12f", *BASE_FROM_OPTICAL[:3].ravel())
    calibration = head + struct.pack("<35d", *k, *[0.0] * 5, *np.eye(3).ravel(), *p) + local
    ids, poses = [], []
    for i in range(len(recording)):
        frame, key = recording[i], 4 + 2 * i
        pose = (frame.world_from_camera @ invert(BASE_FROM_OPTICAL))[:3].astype(np.float32)
        ids.append(key)
        poses.append(pose)
        off = np.zeros((3, 4), np.float32)
        off[:, 3] = 1.0 if optimised else 0.0
        colour, depth = BytesIO(), BytesIO()
        Image.fromarray(frame.rgb).save(colour, "JPEG", quality=95)
        if frame.depth_m is not None:
            whole = np.nan_to_num(frame.depth_m)
            millimetres = np.rint(whole * 1000).astype(np.uint16)
            channels = np.ascontiguousarray(whole)[..., None].view(np.uint8)[..., [2, 1, 0, 3]]
            if depth_as == "rvl":
                depth.write(b"DEPTHRVL" + struct.pack("<2I", c.width, c.height) + rvl(millimetres))
            else:
                Image.fromarray(channels if depth_as == "float" else millimetres).save(depth, "PNG")
        base.execute("INSERT INTO Node VALUES (?, 0, ?, ?)", (key, 1_700_000_000.0 + i / 10, (pose + off).tobytes()))
        row = (key, colour.getvalue(), depth.getvalue() or None, calibration, None)
        base.execute("INSERT INTO Data VALUES (?, ?, ?, ?, ?)", row)
    blobs = (packed(np.array(ids, np.int32)), packed(np.array(poses))) if optimised else (None, None)
    base.execute("INSERT INTO Admin VALUES ('0.21.4', ?, ?)", blobs)
    base.commit()
    base.close()
