"""Table of skipped tests over the environments of CI, from pytest's JUnit files: python3 .ci/skips.py FILE…

A test that every environment skips is an error, but where only another machine can run it.
"""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from collections import defaultdict
from pathlib import Path

ELSEWHERE = ("root", "another machine", "cores", "chromium", "Fast DDS", "fastdds", "rtsm", "Windows", "macOS")
"""Parts of reasons that are the machine's, and no environment's."""


def main() -> int:
    ran, skipped = defaultdict[str, set[str]](set), dict[str, str]()
    for file in map(Path, sys.argv[1:]):
        for case in ET.parse(file).iter("testcase"):
            test = f"{case.get('classname')}::{case.get('name')}"
            why = case.find("skipped")
            if why is not None and why.get("type") == "pytest.skip":
                skipped.setdefault(test, str(why.get("message")))
            elif why is None:
                ran[test].add(file.stem)
    by_reason = defaultdict[tuple[str, str], int](int)
    nowhere = list[str]()
    for test, reason in skipped.items():
        by_reason[reason, ", ".join(sorted(ran[test])) or "nowhere"] += 1
        if not ran[test] and not any(part in reason for part in ELSEWHERE):
            nowhere.append(f"{test}: {reason}")
    print("| skipped tests | reason | run in |\n|---:|---|---|")
    for (reason, where), count in sorted(by_reason.items()):
        print(f"| {count} | {reason} | {where} |")
    print(*(f"SKIPPED EVERYWHERE: {line}" for line in nowhere), sep="\n")
    return int(bool(nowhere))


if __name__ == "__main__":
    sys.exit(main())
