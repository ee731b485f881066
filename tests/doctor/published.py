"""Two published layouts with pictures of our own: 7-Scenes with unregistered depth, and AI2-THOR frames on disk.

python tests/doctor/published.py FOLDER      writes the ten frames of tests/data/sevenscenes anew
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import numpy as np
from faulty_recordings import Walk, moved
from PIL import Image

from cartier.contracts import Recording
from cartier.types import Camera
from cartier_bench.datasets.sevenscenes import REGISTRATION
from cartier_dollhouse.place import Plan
from cartier_dollhouse.recording import look
from cartier_dollhouse.render import Renderer
from cartier_dollhouse.scene import load_home

DATA = Path(__file__).resolve().parents[1] / "data" / "sevenscenes"
KITCHEN = "kitchen_diner"
SIDE, EYE_M, PITCH_DEG, METRES_OF_255 = 160, 1.576, 30.0, 5.0


def write_sevenscenes(recording: Recording, root: Path, numbers: range) -> None:
    """The 7-Scenes layout: the world hangs on the first camera, and the depth is the infrared camera's own.

    That camera has a longer lens and stands beside the colour camera; ``camera-intrinsics.txt`` has its lens.
    """
    root.mkdir(parents=True, exist_ok=True)
    zoom, dx, dy = REGISTRATION
    raw = moved(1 / zoom, -dx / zoom, -dy / zoom)  # pixels of a 640 px wide image
    first = np.linalg.inv(recording[numbers[0]].world_from_camera)
    for i in numbers:
        frame, stem = recording[i], root / f"frame-{20 * i:06d}"
        assert frame.depth_m is not None
        Image.fromarray(frame.rgb).save(f"{stem}.color.jpg", quality=90)
        depth_m = raw(frame.depth_m, i)
        millimetres = np.where(np.isnan(depth_m), 65535, np.rint(depth_m * 1000))
        Image.fromarray(millimetres.astype(np.uint16)).save(f"{stem}.depth.png", optimize=True)
        np.savetxt(f"{stem}.pose.txt", first @ frame.world_from_camera, fmt="%.7f", delimiter="\t")
    c = recording.camera
    matrix = [[c.fx / zoom, 0, c.cx], [0, c.fy / zoom, c.cy], [0, 0, 1]]
    np.savetxt(root / "camera-intrinsics.txt", matrix, fmt="%.6f")


def kitchen(max_frames: int = 60) -> Recording:
    """A walk through a built-in kitchen, seen by a disturbed sensor."""
    return Walk(KITCHEN, width=160, max_frames=max_frames).seen(sensor=True)


def write_thor(home: str, root: Path, frames: int = 44) -> None:
    """AI2-THOR frames as ``faulty_recordings.Thor`` reads them: square, depth of 8 bits, poses in Unity's frame."""
    scene = load_home(home)
    plan, rng = Plan(scene, 0.2), np.random.default_rng(0)
    focal = SIDE / 2  # 90°
    renderer = Renderer(scene, Camera(SIDE, SIDE, focal, focal, (SIDE - 1) / 2, (SIDE - 1) / 2))
    told, (xy, yaw) = [], (np.array(scene.start_xy, float), 0)
    root.mkdir(parents=True, exist_ok=True)
    for number in range(frames):
        unity_yaw = math.radians(yaw)  # clockwise from +z, which is our y
        view = renderer.render(look(xy, math.pi / 2 - unity_yaw, math.radians(PITCH_DEG), EYE_M))
        value = np.clip(np.nan_to_num(view.depth_m * 255 / METRES_OF_255, nan=255.0), 0, 255)
        Image.fromarray(value.astype(np.uint8)).save(root / f"{number:04d}_depth.png")
        Image.fromarray(view.rgb).save(root / f"{number:04d}_rgb.png")
        told.append({"frame": number, "position": [xy[0], EYE_M, xy[1]], "yaw_deg": yaw, "pitch_down_deg": PITCH_DEG})
        ahead = xy + 0.25 * np.array([math.sin(unity_yaw), math.cos(unity_yaw)])
        if plan.free((float(ahead[0]), float(ahead[1]))):
            xy = ahead
        else:
            yaw = (yaw + int(rng.choice([30, 330]))) % 360
    intrinsics = {"width": SIDE, "height": SIDE, "fx": focal, "fy": focal}
    (root / "poses.json").write_text(json.dumps({"intrinsics": intrinsics, "frames": told}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=DATA)
    write_sevenscenes(kitchen(), parser.parse_args().folder, range(0, 60, 6))


if __name__ == "__main__":
    main()
