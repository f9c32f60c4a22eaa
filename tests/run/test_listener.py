"""Who is told of a run beside its console."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from run_helpers import Bench

from tsbench.core.errors import InputError
from tsbench.run.listener import make_listener

MINE = """
from pathlib import Path

class Mine:
    def started(self, run): Path("told").write_text(f"{run.asked} {run.options['split']}\\n")
    def episode(self, row):
        with open("told", "a") as file: file.write(f"{row['planner']} {row['scd']}\\n")
    def finished(self, result):
        with open("told", "a") as file: file.write(f"{result.status} {result.summary is not None}\\n")

class Deaf:
    def started(self, run): pass

def function(run): pass
"""
RUN = ["run", "--planner", "fake_planners:Good", "--split", "test", "--limit", "2", "--workers", "1", "--out", "out"]


@pytest.fixture
def mine(bench: Bench) -> Path:
    path = bench.folder / "tracker.py"
    path.write_text(MINE)
    return path


def test_a_listener_of_ones_own(bench: Bench, mine: Path) -> None:
    bench.run(*RUN, "--listener", f"{mine}:Mine")
    begin, *rows, end = (bench.folder / "told").read_text().splitlines()
    assert begin == "{'Good': 2} test"
    assert [row.split()[0] for row in rows] == ["Good", "Good"]
    assert end == "complete True"
    # All is done: no episode is told twice.
    bench.run(*RUN, "--listener", f"{mine}:Mine")
    assert (bench.folder / "told").read_text().splitlines() == [begin, end]


@pytest.mark.slow
def test_tensorboard(bench: Bench) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    bench.run(*RUN, "--listener", "tensorboard")
    # What it leaves in the run's folder is not foreign there.
    assert bench.run(*RUN).stderr.splitlines() == [
        "note: out: complete since "
        + json.loads((bench.folder / "out" / "run.json").read_text())["finished"]
        + ", nothing is driven; --overwrite drives it again"
    ]
    found = EventAccumulator(str(bench.folder / "out" / "tensorboard")).Reload()
    steps = [one.step for one in found.Scalars("episodes_with_scd/Good")]
    assert steps == [1, 2]
    assert found.Scalars("signed_scd/Good")[0].value in (0.0, 50.0, 100.0)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("wandb", "expected tensorboard, pkg.module:Class or file.py:Class"),
        ("no_such_module_here:X", "there is no module no_such_module_here"),
        ("{mine}:Deaf", "expected a class with started, episode and finished"),
        ("{mine}:function", "expected a class with started, episode and finished"),
    ],
)
def test_what_is_no_listener(name: str, words: str, mine: Path) -> None:
    with pytest.raises(InputError) as told:
        make_listener(name.format(mine=mine))
    assert words in str(told.value)
