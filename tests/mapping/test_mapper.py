"""How far one frame travels: the files of cartier that take in its detections."""

from __future__ import annotations

import sys
from types import FrameType

import pytest

from cartier.mapping.mapper import Mapper
from synthetic import THINGS, TrueBoxes, walk

INTERVAL = 10  # frames between two passes of merging, which is a file of its own


@pytest.mark.parametrize("with_depth", [True, False])
def test_detections_enter_ten_files(with_depth: bool) -> None:
    detector, recording = TrueBoxes(THINGS), walk(with_depth=with_depth)
    mapper, entered = Mapper(detector), list[set[str]]()

    def note(frame: FrameType, event: str, argument: object) -> None:
        if event == "call" and "/cartier/" in frame.f_code.co_filename:
            entered[-1].add(frame.f_code.co_filename.rpartition("/cartier/")[2])

    for number in range(len(recording)):
        frame = recording[number]
        found = detector.detect(frame)
        assert mapper.integrate_depth(frame)
        entered.append(set())
        before = sys.getprofile()
        sys.setprofile(note)
        try:
            mapper.integrate_detections(frame, found)
        finally:
            sys.setprofile(before)
    for number, files in enumerate(entered[1:], 2):  # the first frame makes the table of colours
        usual = files - {"mapping/merging.py"}
        assert "mapping/object_map.py" in files and len(usual) <= 10, sorted(usual)
        assert ("mapping/merging.py" in files) == (number % INTERVAL == 0)
