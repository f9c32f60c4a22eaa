"""`tsbench debug`: what the planner prints, asks the debugger for and raises reaches whoever wrote it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from patience import HANG_S

import tsbench
from tsbench.cli import cli
from tsbench.core.errors import InputError

SCENARIO = min(one.scenario_id for one in tsbench.load_scenarios("dev", "yield"))
PLANNER = """
from tsbench import Control

class Mine:
    floor = False
    def reset(self, context): print("begins")
    def act(self, observation):
        {deed}
        return Control(0.0, 0.0)
"""


def debug(*words: object) -> Result:
    return CliRunner().invoke(cli, ["debug", *map(str, words)], catch_exceptions=False)


def at_a_console(typed: str, *words: object) -> str:
    """What is shown where somebody types; in a process of its own, as pytest has a debugger of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "tsbench", "debug", *map(str, words)],
        input=typed, capture_output=True, text=True, timeout=HANG_S, check=True,
        env={key: value for key, value in os.environ.items() if key != "PYTHONBREAKPOINT"},
    )  # fmt: skip
    assert "Traceback" not in done.stdout + done.stderr
    return done.stdout


def planner(folder: Path, deed: str) -> str:
    (folder / "mine.py").write_text(PLANNER.format(deed=deed))
    return f"{folder}/mine.py:Mine"


def test_where_it_raises_is_shown_with_what_it_saw(tmp_path: Path) -> None:
    mine = planner(tmp_path, "assert observation.step < 3, 'too far'")
    done = debug("--planner", mine, "--scenario", SCENARIO)
    assert done.exit_code == 1
    assert "begins" in done.output
    assert "t 0.3 s: ego " in done.output
    assert 'mine.py", line 8, in act' in done.output
    assert done.output.rstrip().endswith("AssertionError: too far")


def test_breakpoint_works(tmp_path: Path) -> None:
    mine = planner(tmp_path, "if observation.step == 2: breakpoint()")
    shown = at_a_console("p observation.step * 100\nq\n", "--planner", mine, "--scenario", SCENARIO)
    assert "(Pdb) 200" in shown


def test_the_debugger_stops_at_each_tick_from_a_time_on(tmp_path: Path) -> None:
    typed = "p observation.step * 100\nc\np observation.step * 100\nq\n"
    mine = planner(tmp_path, "pass")
    shown = at_a_console(typed, "--planner", mine, "--scenario", SCENARIO, "--at", 0.5, "--pdb")
    assert "t 0.5 s: ego " in shown
    assert "(Pdb) 500" in shown
    assert "(Pdb) 600" in shown
    assert shown.count("-> pass") == 2, "the second time it was left"


def test_an_episode_of_a_run_is_driven_as_it_was(tmp_path: Path) -> None:
    tsbench.evaluate(
        ["idm", "reader"], split="dev", types="yield", limit=2, workers=1, out=tmp_path / "run", mask_signs=True
    )
    row = tsbench.load_run(tmp_path / "run").episodes.iloc[0]
    done = debug(tmp_path / "run", f"idm/{row.scenario_id}", "--png", tmp_path / "end.png")
    assert done.output.startswith(f"Episode ended: {row.outcome}")
    assert (tmp_path / "end.png").read_bytes().startswith(b"\x89PNG")
    seen = debug(tmp_path / "run", f"reader/{row.scenario_id}", "--at", "0")
    assert "plate (masked)" in seen.output
    with pytest.raises(InputError, match=r"name one of idm/.*, reader/"):
        debug(tmp_path / "run", row.scenario_id)
    with pytest.raises(InputError, match="name RUN and EPISODE alone"):
        debug(tmp_path / "run", row.scenario_id, "--planner", "idm")


def test_nothing_to_drive_is_one_line() -> None:
    with pytest.raises(InputError, match="name what to drive: RUN EPISODE, or --planner and --scenario"):
        debug("--planner", "idm")
    with pytest.raises(InputError, match="name what to drive: RUN EPISODE, or --planner and --scenario"):
        debug(SCENARIO)
    with pytest.raises(InputError, match=rf"no scenario of any split .* \(did you mean {SCENARIO}\?\); tsbench scen"):
        debug("--planner", "idm", "--scenario", SCENARIO.replace("-msk-", "-mks-"))
