"""Benchmark of hub detectors, time per frame with reading: OWLv2-base with LVIS's 1,203 names, and D-FINE.

python benchmarks/hub.py [RECORDING] [--frames N] [--device cuda]
    (default: 64 frames of the dollhouse's studio, 640×480, 2 on a CPU)
Their weights are random: the time is that of trained ones, the boxes mean nothing. Medians of five; on a CPU one
thread. Limits on an H100 with four threads that read: OWLv2 6 ms a frame, D-FINE 4 ms; on a CPU no slower than with the
model's own processor.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from command_line import Parser, run_script

from cartier import plugins
from cartier.contracts import Recording
from cartier.detectors.transformers import TransformersDetector, make
from cartier.mapping.prefetch import batch_size, prefetch
from cartier.recordings import folder as own_format
from cartier.types import Frame

LIMITS_MS = {"owlv2": 6.0, "d_fine": 4.0}
PATCHES_PX = 960


def owlv2(folder: Path) -> None:
    """OWLv2-base, patches of 16 px of 960×960: the published one's sizes, but for the table of its tokens."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "detectors"))
    import transformers as hf
    from tiny_transformers import _clip_tokenizer

    tokenizer = _clip_tokenizer(folder, 16)
    text = {"vocab_size": len(tokenizer), "bos_token_id": len(tokenizer) - 2, "eos_token_id": len(tokenizer) - 1}
    config = hf.Owlv2Config(text_config=text, vision_config={"image_size": PATCHES_PX, "patch_size": 16})
    size = {"height": PATCHES_PX, "width": PATCHES_PX}
    for part in (hf.Owlv2ForObjectDetection(config), hf.Owlv2ImageProcessorPil(size=size), tokenizer):
        part.save_pretrained(folder)


def d_fine(folder: Path) -> None:
    """D-FINE as its configuration comes: 31 million parameters."""
    import transformers as hf

    for part in (hf.DFineForObjectDetection(hf.DFineConfig(num_labels=80)), hf.RTDetrImageProcessorPil()):
        part.save_pretrained(folder)


def main() -> None:
    parser = Parser(__doc__)
    parser.add_argument("recording", nargs="?", help="default: the dollhouse's studio")
    parser.add_argument("--frames", type=int, help="how many (default: 64, on a CPU 2)")
    parser.add_argument("--device", help="cuda or cpu (default: cuda where there is one)")
    given = parser.parse_args()
    import torch

    given.device = given.device or ("cuda" if torch.cuda.is_available() else "cpu")
    given.frames = given.frames or (64 if given.device.startswith("cuda") else 2)
    torch.set_num_threads(1)
    torch.manual_seed(0)
    with tempfile.TemporaryDirectory() as temporary:
        root = Path(temporary)
        recording = (
            plugins.open_recording(given.recording) if given.recording else studio(root / "frames", given.frames)
        )
        where = torch.cuda.get_device_name() if given.device.startswith("cuda") else "CPU, one thread"
        size = f"{recording.camera.width}x{recording.camera.height}"
        frames = min(given.frames, len(recording))
        print(f"{where}, torch {torch.__version__}; {frames} frames of {recording.name}, {size} px")
        missed = []
        for build in (owlv2, d_fine):
            name = build.__name__
            (root / name).mkdir()
            build(root / name)
            detector = make(root / name, device=given.device)
            whole_ms = measured(name, detector, recording, frames)
            if given.device.startswith("cuda") and whole_ms > LIMITS_MS[name]:
                missed.append(f"{name}: {whole_ms:.1f} ms a frame, limit {LIMITS_MS[name]:g}")
    if missed:
        sys.exit("\n".join(missed))


def studio(folder: Path, frames: int) -> Recording:
    world = plugins.make("worlds", "dollhouse", width=640, height=480)
    own_format.save(world.explore("studio", max_frames=frames), folder)
    return plugins.open_recording(folder)


def measured(name: str, detector: TransformersDetector, recording: Recording, count: int) -> float:
    """Prints what the steps take, and gives the milliseconds per frame of reading and detecting together."""
    some = [recording[number] for number in range(min(32, count))]
    rgbs, images = [frame.rgb for frame in some], detector._images
    differ = (images(rgbs[:1])["pixel_values"] - images._theirs(rgbs[:1])["pixel_values"]).abs()
    together = batch_size(detector, recording.camera)
    batch = some[:together]
    parameters = sum(p.numel() for p in detector._loaded.model.parameters()) / 1e6
    names = len(detector.knows)
    print(f"\n{name}: {parameters:.0f} M parameters of random weights, {names} names, {together} frames at once")
    told = {
        "its own processor, on the CPU": each(lambda: images._theirs(rgbs[:1])),
        "the same input made on the device": each(lambda: images(rgbs[:together])) / together,
        "detect, frame by frame": each(lambda: detector.detect(some[0])),
        f"detect_batch, {together} at once": each(lambda: detector.detect_batch(batch)) / together,
        "reading a frame, one thread": each(lambda: recording[0]),
    }
    for what, ms in told.items():
        print(f"  {what:36}{ms:8.1f} ms a frame")
    whole = each(lambda: run(detector, recording, count), 3) / count
    print(f"  {'reading ahead and detecting, in all':36}{whole:8.1f} ms a frame")
    print(f"  the inputs differ by {float(differ.mean()):.1e} on average, {float(differ.max()):.1e} at most")
    return whole


def run(detector: TransformersDetector, recording: Recording, count: int) -> None:
    """What ``map_home`` does to find the objects of frames, all of which are looked at."""
    waiting, together = list[Frame](), batch_size(detector, recording.camera)
    for done, frame in enumerate(prefetch(recording, together), 1):
        waiting.append(frame)
        if len(waiting) >= together or done == count:
            assert len(detector.detect_batch(waiting)) == len(waiting)
            waiting = []
        if done == count:
            return


def each(call: Callable[[], Any], times: int = 5) -> float:
    """Median milliseconds, the device's work included; the first time does not count."""
    import torch

    spent = []
    for _ in range(times + 1):
        begin = time.perf_counter()
        call()
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        spent.append((time.perf_counter() - begin) * 1e3)
    return float(statistics.median(spent[1:]))


if __name__ == "__main__":
    run_script(main)
