"""Sends frames to cartier from any program: writes its framing to standard output.

cartier live HOME --from "exec:python examples/send_frames.py FOLDER"

Before each frame comes one line of JSON, then the bytes of the images that it announces. Here they come from a folder
in cartier's own format; a robot's program would take them from its camera and its odometry.
"""

import json
import sys
import time
from pathlib import Path

folder = Path(sys.argv[1])
speed = float(sys.argv[2]) if len(sys.argv) > 2 else 1.0
camera = json.loads((folder / "recording.json").read_text())["camera"]
lines = [line.split() for line in (folder / "trajectory.txt").read_text().splitlines() if not line.startswith("#")]
begin = time.monotonic()
for number, line in enumerate(lines):
    time_s, *pose = map(float, line[:8])  # pose: x y z qx qy qz qw of the camera in the map, optical axes
    time.sleep(max(0, begin + (time_s - float(lines[0][0])) / speed - time.monotonic()))
    rgb = (folder / f"rgb/{number:06d}.jpg").read_bytes()
    depth = (folder / f"depth/{number:06d}.png").read_bytes()  # 16-bit, millimetres, 0 = none
    head = {
        "stamp_ns": round(time_s * 1e9),
        "camera": [camera[name] for name in ("width", "height", "fx", "fy", "cx", "cy")],
        "pose": pose,
        "rgb": len(rgb),
        "rgb_format": "jpeg",
        "depth": len(depth),
        "depth_format": "png",
    }
    sys.stdout.buffer.write(json.dumps(head).encode() + b"\n" + rgb + depth)
    sys.stdout.buffer.flush()
