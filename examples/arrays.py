"""A toy reader in one file, for folders of NumPy arrays: `cartier map FOLDER --format examples/arrays.py`.

The folder holds rgb.npy (N, H, W, 3) uint8, depth_m.npy (N, H, W) float32, world_from_camera.npy (N, 4, 4) and
camera.npy (fx, fy, cx, cy). `python examples/arrays.py RECORDING FOLDER` writes one.
"""

import hashlib
import sys
from pathlib import Path

import numpy as np

import cartier
from cartier import Camera, Frame, InputError
from cartier.contracts import Recording, RecordingDefaults

FILES = ("rgb", "depth_m", "world_from_camera", "camera")
FRAMES_PER_SECOND = 10.0


def matches(path: Path) -> bool:
    """Whether a path looks like such a folder; only names are looked at."""
    return all((path / f"{name}.npy").is_file() for name in FILES)


def open(path: Path) -> "Arrays":
    return Arrays(path)


class Arrays(RecordingDefaults, Recording):
    def __init__(self, path: Path) -> None:
        try:  # mapped into memory: a frame is read when it is asked for; no pickle
            self._arrays = [np.load(path / f"{name}.npy", mmap_mode="r", allow_pickle=False) for name in FILES]
        except (OSError, ValueError, EOFError) as error:
            raise InputError(f"{path} holds an array that cannot be read: {error}") from error
        (self._rgb, self._depth_m, self._poses), lens = self._arrays[:3], self._arrays[3]
        if self._rgb.ndim != 4 or not len(self._rgb) == len(self._depth_m) == len(self._poses) or lens.shape != (4,):
            raise InputError(f"{path}: rgb.npy, depth_m.npy and world_from_camera.npy must have a row for each frame")
        self.name, self.truth = path.name, None
        self.notes = (f"arrays have no times: {FRAMES_PER_SECOND:g} frames a second are assumed",)
        self.camera = Camera(self._rgb.shape[2], self._rgb.shape[1], *map(float, lens))

    def __len__(self) -> int:
        return len(self._rgb)

    def __getitem__(self, index: int) -> Frame:
        if not 0 <= index < len(self):  # the contract: negative numbers, too, are an IndexError
            raise IndexError(f"there is no frame {index}: {self.name} has {len(self)}")
        rgb, depth_m, pose = (np.array(array[index]) for array in (self._rgb, self._depth_m, self._poses))
        return Frame(index, index / FRAMES_PER_SECOND, rgb, depth_m, pose, self.camera)

    def fingerprint(self) -> str:
        total = hashlib.sha256()
        for array in self._arrays:
            total.update(str((array.shape, array.dtype)).encode())
            total.update(np.ascontiguousarray(array))
        return total.hexdigest()


def write(recording: Recording, folder: Path) -> None:
    frames = [recording[number] for number in range(len(recording))]
    folder.mkdir(parents=True, exist_ok=True)
    lens = recording.camera
    arrays = [frame.rgb for frame in frames], [frame.depth_m for frame in frames], [f.world_from_camera for f in frames]
    for name, array in zip(FILES, (*arrays, [lens.fx, lens.fy, lens.cx, lens.cy]), strict=True):
        np.save(folder / f"{name}.npy", np.array(array), allow_pickle=False)


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    write(cartier.open_recording(sys.argv[1]), Path(sys.argv[2]))
