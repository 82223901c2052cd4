# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Speed, as ratios against a named alternative measured in the same run: python -m benchmarks [NAME ...]."""

from __future__ import annotations

import argparse

from benchmarks import advice, estimation, exact, monitoring, node, paper, recordings, reversal, start

_ALL = {
    module.__name__.rpartition(".")[2]: module
    for module in (start, paper, monitoring, exact, reversal, advice, recordings, node, estimation)
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(_ALL)}; without any all of them, 10 min")
    names = parser.parse_args().names
    if unknown := [name for name in names if name not in _ALL]:
        parser.error(f"there is no benchmark {', '.join(unknown)}, but {', '.join(_ALL)}")
    for name in names or _ALL:
        _ALL[name].run()
