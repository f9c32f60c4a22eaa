"""Code that changes while a run drives it: the run says so, stays open, and is not continued."""

from __future__ import annotations

import json
from itertools import count
from pathlib import Path

import pytest

import tsbench
from tsbench.core.errors import InputError
from tsbench.run import session

HONEST = """
from tsbench import Control

class {name}:
    floor = False
    def reset(self, context): pass
    def act(self, observation):
        {deed}
        return Control(1.0, 0.0)
"""
# Once its module is loaded, what stands in the file is another planner's.
REWRITES = "open(__file__, 'a').write('more = 1\\n')"


def drive(out: Path, *planners: str) -> tsbench.Run:
    return tsbench.evaluate(list(planners), split="dev", types=["speed_limit"], limit=1, workers=1, out=out)


def status(out: Path) -> str:
    return str(json.loads((out / "run.json").read_text())["status"])


@pytest.mark.parametrize("deed", ["pass", REWRITES])
def test_who_rewrites_a_planner_on_disk_is_named(tmp_path: Path, deed: str) -> None:
    file, out = tmp_path / "mine.py", tmp_path / "run"
    file.write_text(HONEST.format(name="Mine", deed=deed))
    if deed == "pass":
        drive(out, f"{file}:Mine")
        assert status(out) == "complete"
        return
    with pytest.raises(InputError, match=r"mine\.py:Mine': its code has changed since the run began"):
        drive(out, f"{file}:Mine")
    assert status(out) == "interrupted"
    with pytest.raises(InputError, match=r"holds another run: planner .* has changed since"):
        drive(out, f"{file}:Mine")


def test_a_planner_may_extend_the_path_of_its_modules(tmp_path: Path) -> None:
    (tmp_path / "library").mkdir()
    (tmp_path / "library" / "deeds_of_mine.py").write_text("GENTLE = 1.0\n")
    file, out = tmp_path / "mine.py", tmp_path / "run"
    found = f"import sys\nsys.path.insert(0, {str(tmp_path / 'library')!r})\nimport deeds_of_mine\n"
    file.write_text(found + HONEST.format(name="Mine", deed="pass"))
    drive(out, f"{file}:Mine")
    assert status(out) == "complete"
    (tmp_path / "library" / "deeds_of_mine.py").write_text("GENTLE = 2.0\n")
    with pytest.raises(InputError, match=r"holds another run: planner .* has changed since"):
        drive(out, f"{file}:Mine")


def test_a_run_of_two_states_of_tsbench_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # What is found at the start of the run, and at its end.
    times = count()
    monkeypatch.setattr(session, "code_stamps", lambda: {Path("seeds.py"): (0, next(times))})
    with pytest.raises(InputError, match="tsbench's code has changed since the run began"):
        drive(tmp_path / "run", "idm")
    assert status(tmp_path / "run") == "interrupted"
    monkeypatch.undo()
    run = drive(tmp_path / "run", "idm")
    assert status(tmp_path / "run") == "complete"
    # Which code made its first rows is not known.
    assert run.edition.endswith("+local")
