# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 The stickslip_ros developers
"""The process for slow work ends at once, and lets the node end, whatever was being sent to it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import LIMIT

from stickslip_ros.nodes.slow_work import SlowWork

# More than a pipe holds: it is still being written when the process is killed.
_LARGE = 20_000_000

_ENDS_MEANWHILE = f"""
from stickslip_ros.nodes.slow_work import SlowWork

if __name__ == "__main__":
    work = SlowWork(print)
    assert work.submit(("a", "question"), len, bytes({_LARGE}))
    work.close()
"""


@pytest.mark.slow
def test_the_node_ends_while_a_question_is_being_sent(tmp_path: Path) -> None:
    """On Python 3.10 a node that was interrupted then never ended (seen in CI of issue 21)."""
    script = tmp_path / "ends_meanwhile.py"
    script.write_text(_ENDS_MEANWHILE)
    subprocess.run([sys.executable, str(script)], check=True, timeout=LIMIT)


@pytest.mark.slow
def test_another_process_answers_after_one_was_killed_while_a_question_was_being_sent() -> None:
    """What a shortage of memory does: the question is lost, and said to be; the next one is answered."""
    said: list[str] = []
    work = SlowWork(said.append)
    until = time.monotonic() + LIMIT
    try:
        for _ in range(20):
            assert work.submit(("a", "question"), len, bytes(_LARGE))
            (process_id,) = work.process_ids
            os.kill(process_id, signal.SIGKILL)
            # Asked without a pause: the pool's own thread is then still closing its pipes.
            while (lost := work.pop_result(("a", "question"))) is None:
                assert time.monotonic() < until
            assert lost[1] is None
        assert said == ["the process for slow work ended unexpectedly; another one is begun"] * 20
        assert work.submit(("a", "question"), len, bytes(_LARGE))
        while (done := work.pop_result(("a", "question"))) is None:
            assert time.monotonic() < until
            time.sleep(0.01)
        assert done[1] == _LARGE
    finally:
        work.close()
