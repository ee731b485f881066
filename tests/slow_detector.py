"""True boxes of the synthetic room, as slowly as asked: a detector by path for the command-line tests."""

import time

from cartier.types import Detections, Frame
from synthetic import THINGS, TrueBoxes


def make(threshold: float = 0.0, pause_s: float = 0.0) -> "SlowDetector":
    return SlowDetector(pause_s)


class SlowDetector(TrueBoxes):
    def __init__(self, pause_s: float) -> None:
        super().__init__(THINGS)
        self.pause_s = pause_s

    def detect(self, frame: Frame) -> Detections:
        time.sleep(self.pause_s)
        return super().detect(frame)
