"""What an isolated planner prints reaches no terminal as it is."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from pathlib import Path

import pytest
from patience import HANG_S

from tsbench.board.isolation.process import Printed

PRINTS = """
import os, sys
print("\\x1b]0;owned\\x07\\x1b[31mred", flush=True)
os.write(2, b"\\x1b[2Jcleared \\xe2\\x80\\xaeback \\xff")
# A terminal that is open can be read from, too.
assert not any(os.isatty(one) for one in range(10))

class P:
    def reset(self, context): pass
    def act(self, observation): pass
"""
CODE = "import sys; from tsbench.board.isolation.isolated_loading import describe; describe(sys.argv[1])"


def test_a_terminal_is_shown_text(tmp_path: Path) -> None:
    """By a run before it begins, `verify` and `planners check`: all ask a planner what it is."""
    file = tmp_path / "mine.py"
    file.write_text(PRINTS)
    ours, theirs = pty.openpty()
    done = subprocess.run(
        [sys.executable, "-c", CODE, f"{file}:P"], stdin=theirs, stdout=theirs, stderr=theirs, timeout=HANG_S,
        check=False, env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    os.close(theirs)
    shown = os.read(ours, 1 << 16).decode()
    os.close(ours)
    assert done.returncode == 0, shown
    assert shown.splitlines() == ["\\x1b]0;owned\\x07\\x1b[31mred", "\\x1b[2Jcleared \\u202eback \ufffd"]


def test_of_a_flood_the_beginning_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    printed = Printed()
    subprocess.run(
        ["sh", "-c", "head -c 90000 /dev/zero | tr '\\0' x; echo; yes | head -c 9000000"], stdout=printed.end
    )
    printed.close_end()
    printed.wait()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "x" * 90_000
    assert set(lines[1:-1]) == {"y"}
    assert len("".join(lines[:-1])) <= 100_000
    assert lines[-1] == "(what the planner prints from here on is not shown)"


def test_one_long_line_is_no_way_round(capsys: pytest.CaptureFixture[str]) -> None:
    printed = Printed()
    subprocess.run(["sh", "-c", "head -c 9000000 /dev/zero | tr '\\0' x"], stdout=printed.end, check=True)
    printed.close_end()
    printed.wait()
    assert capsys.readouterr().err == "(what the planner prints from here on is not shown)\n"
