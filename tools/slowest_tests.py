# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Prints which files of tests took longest, from what `make test` has written.

Run from the repository: python tools/slowest_tests.py [FILE]
"""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

_PRINTED = 30


def main(path: Path) -> None:
    """Print the files and the single tests that took longest [s]."""
    files: defaultdict[str, float] = defaultdict(float)
    tests: defaultdict[str, float] = defaultdict(float)
    for case in ElementTree.parse(path).iter("testcase"):
        spent = float(case.get("time", "0"))
        files[case.get("classname", "")] += spent
        tests[f"{case.get('classname', '')}.{case.get('name', '')}"] += spent
    print(f"{sum(files.values()):.0f} s of all workers together")
    for title, found in (("files", files), ("tests", tests)):
        print(f"\n{title}:")
        for name, spent in sorted(found.items(), key=lambda one: -one[1])[:_PRINTED]:
            print(f"{spent:7.1f} s  {name[:120]}")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else ".test_times.xml"))
