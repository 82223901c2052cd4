# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""Speed, as ratios against a named alternative measured in the same run: python -m benchmarks."""

from __future__ import annotations

from benchmarks import advice, estimation, exact, monitoring, node, paper, recordings, reversal, start

if __name__ == "__main__":
    start.run()
    paper.run()
    monitoring.run()
    exact.run()
    reversal.run()
    advice.run()
    recordings.run()
    node.run()
    estimation.run()
