"""Killed at any moment and continued, with any number of workers: the same bytes."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest
from run_helpers import Bench, assert_gone, workers_of

from tsbench.run.log.journal import read_table
from tsbench.scenarios.data_set import read_table as read_scenarios
from tsbench.scenarios.data_set import write_table

# Twenty episodes, one of which fails.
RUN = [
    "run", "--planner", "fake_planners:Slow", "--planner", "fake_planners:Raises", "--split", "test",
    "--types", "speed_limit",
]  # fmt: skip
TABLES = ("episodes.parquet", "violations.parquet")


def bytes_of(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in TABLES]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, make_data) -> Bench:
    """A data folder with an undisturbed run by one worker in it."""
    folder = tmp_path_factory.mktemp("whole")
    bench = Bench(make_data(folder / "data", maps=1), folder)
    bench.run(*RUN, "--out", "whole", "--workers", "1", expect=1)
    return bench


def test_killed_twice_and_continued(whole: Bench) -> None:
    folder = whole.folder / "killed"
    for lines in (1, 12):
        process = whole.start_paused(lines, *RUN, "--out", "killed", "--workers", "2")
        workers = workers_of(process)
        assert len(workers) == 2
        process.kill()
        process.communicate()
        assert_gone(workers)
        assert json.loads((folder / "run.json").read_text())["status"] == "running"
    done = whole.run(*RUN, "--out", "killed", "--workers", "2", expect=1)
    assert "continuing: 12 of 20 episodes are already there" in done.stderr
    assert bytes_of(folder) == bytes_of(whole.folder / "whole")
    assert len(json.loads((folder / "run.json").read_text())["sessions"]) == 3


def test_workers_killed_are_replaced_with_another_hash_seed_too(whole: Bench) -> None:
    process = whole.start_paused(5, *RUN, "--out", "worker", "--workers", "2", PYTHONHASHSEED="77")
    for worker in workers_of(process):
        os.kill(worker, signal.SIGKILL)
    whole.go(process, expect=1)
    assert bytes_of(whole.folder / "worker") == bytes_of(whole.folder / "whole")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_keeps_what_is_finished(whole: Bench, number: signal.Signals) -> None:
    name = f"stopped-{number}"
    process = whole.start_paused(3, *RUN[:3], *RUN[5:], "--out", name, "--workers", "2")
    workers = workers_of(process)
    process.send_signal(number)
    out, err = whole.go(process, expect=130)
    assert "Traceback" not in err
    assert "run the same command again to continue" in out
    assert_gone(workers)
    manifest = json.loads((whole.folder / name / "run.json").read_text())
    assert manifest["status"] == "interrupted"
    episodes = read_table(whole.folder / name / "episodes.parquet")
    assert len(episodes) == manifest["counts"]["finished"]
    assert 3 <= manifest["counts"]["finished"] < 10
    assert not (whole.folder / name / "summary.json").exists()
    assert not list((whole.folder / name / "traces").rglob(".*"))


def test_what_is_torn_or_foreign_is_set_aside_with_its_reason(whole: Bench) -> None:
    folder = whole.folder / "torn"
    process = whole.start_paused(6, *RUN, "--out", "torn", "--workers", "1", "--trace", "all")
    process.kill()
    process.communicate()
    journal = (folder / "journal.jsonl").read_bytes()
    (folder / "journal.jsonl").write_bytes(journal[:-100])
    last = journal.splitlines()[-1].decode()
    traces = [p for p in sorted((folder / "traces" / "Slow").glob("*.parquet")) if p.stem not in last]
    cut = traces[0].read_bytes()[:-9]
    traces[0].write_bytes(cut)
    traces[1].unlink()
    (folder / "notes.txt").write_text("mine")
    (folder / "errors").mkdir(exist_ok=True)
    (folder / "errors" / "odd\nname").write_text("odd")
    (folder / "traces" / "Slow" / "stranger.parquet").write_text("mine too")
    (folder / "traces" / "Slow" / ".half.parquet.123.tmp").write_text("half")

    done = whole.run(*RUN, "--out", "torn", "--workers", "1", "--trace", "all", expect=1)
    aside = folder / "set_aside"
    reasons = (aside / "REASONS.txt").read_text().splitlines()
    for name, reason in (
        (
            "journal.jsonl",
            "lines that are not trusted (2 of an episode whose trace is gone or was changed, 1 torn or changed)",
        ),
        ("traces/Slow/" + traces[0].name, "is not the trace that the run wrote"),
        ("traces/Slow/stranger.parquet", "does not belong to this run"),
        ("traces/Slow/.half.parquet.123.tmp", "half-written"),
        ("notes.txt", "does not belong to this run"),
        ("errors/odd\\nname", "does not belong to this run"),
    ):
        assert any(f": was {name}: {reason}" in line for line in reasons), (name, reasons)
        assert f"torn/{name}: {reason}" in done.stderr
    kept = {path.name.partition("-")[2]: path.read_bytes() for path in aside.iterdir()}
    assert kept["notes.txt"] == b"mine"
    assert kept["stranger.parquet"] == b"mine too"
    assert kept["half.parquet.123.tmp"] == b"half"
    assert kept[traces[0].name] == cut
    assert "continuing: 3 of 20 episodes are already there" in done.stderr
    assert bytes_of(folder) == bytes_of(whole.folder / "whole")
    assert len(list((folder / "traces").rglob("*.parquet"))) == 20


def test_a_complete_run_is_shown_and_not_run_again_and_strangers_stay(whole: Bench) -> None:
    note, trace = (whole.folder / "whole" / "note.txt", whole.folder / "whole" / "traces" / "Slow" / "x.parquet")
    for path in (note, trace):
        path.write_text("mine")
    before = {p: p.stat().st_mtime_ns for p in sorted((whole.folder / "whole").rglob("*"))}
    try:
        done = whole.run(*RUN, "--out", "whole", expect=1)
        assert "20 of 20 episodes finished" in done.stdout
        assert {p: p.stat().st_mtime_ns for p in sorted((whole.folder / "whole").rglob("*"))} == before
        for path in (note, trace):
            assert f"{path.name}: does not belong to this run; left alone, not used" in done.stderr
            assert path.read_text() == "mine"
    finally:
        for path in (note, trace):
            path.unlink()


def test_a_worker_that_grows_is_replaced_between_episodes(bench: Bench) -> None:
    run = ["run", "--planner", "fake_planners:Leaks", "--split", "test", "--limit", "15", "--workers", "1"]
    bench.run(*run, "--out", "free")
    bench.run(*run, "--out", "bound", TSBENCH_TEST_LIMITS='{"memory": 250, "least_episodes": 5}')
    free, bound = (
        json.loads((bench.folder / name / "run.json").read_text())["sessions"][0]["workers"]
        for name in ("free", "bound")
    )
    assert [worker["episodes"] for worker in free] == [15]
    assert free[0]["peak"] > 600
    assert len(bound) >= 2
    assert sum(worker["episodes"] for worker in bound) == 15
    assert all(worker["episodes"] >= 5 for worker in bound[:-1])
    assert max(worker["peak"] for worker in bound) < free[0]["peak"] - 100
    assert bytes_of(bench.folder / "free") == bytes_of(bench.folder / "bound")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (["--limit", "3"], "limit is null, not 3"),
        (["--mask-signs"], "mask_signs is false, not true"),
        (["--planner", "fake_planners:Good"], "planners are"),
    ],
)
def test_another_run_in_the_folder(whole: Bench, change: list[str], words: str) -> None:
    told = whole.refused(*RUN, *change, "--out", "whole")
    assert told.startswith("whole: holds another run: ")
    assert words in told


def test_another_contract_in_the_folder(whole: Bench) -> None:
    table = whole.data / "scenarios" / "test.parquet"
    kept = table.read_bytes()
    try:
        _change_a_row(table)
        done = whole.run(*RUN, "--out", "whole", expect=2)
    finally:
        table.write_bytes(kept)
    assert "holds another run: contract is" in done.stderr


def _change_a_row(table: Path) -> None:
    first, *rest = read_scenarios(table)
    write_table([replace(first, net_sha256="e" * 64), *rest], table)


def test_a_changed_table_of_a_complete_run(whole: Bench) -> None:
    path = whole.folder / "whole" / "episodes.parquet"
    kept = path.read_bytes()
    try:
        path.write_bytes(kept[:-20] + b"x" * 20)
        done = whole.run(*RUN, "--out", "whole", expect=2)
    finally:
        path.write_bytes(kept)
    assert "episodes.parquet: is not the file that the run wrote" in done.stderr


STALE = """
from pathlib import Path
from tsbench import Control

class Mine:
    def __init__(self):
        self.gain = float(Path(__file__).with_suffix(".txt").read_text())

    def reset(self, context): pass
    def act(self, o): return Control(self.gain, 0.0)
"""


def test_another_file_of_weights_is_another_planner(whole: Bench) -> None:
    code, weights = whole.folder / "stale.py", whole.folder / "stale.txt"
    code.write_text(STALE)
    weights.write_text("0.25")
    run = ["run", "--planner", "stale.py:Mine", "--split", "test", "--limit", "4", "--out", "stale"]
    whole.run(*run)
    first = bytes_of(whole.folder / "stale")
    again = whole.run(*run)
    assert "complete since" in again.stderr
    assert "nothing is driven; --overwrite drives it again" in again.stderr
    (whole.folder / "stale" / "mine.txt").write_text("not the run's")
    weights.write_text("0.75")
    done = whole.run(*run, expect=2)
    assert done.stderr == (
        "error: stale: holds another run: planner stale.py:Mine has changed since (its files: stale.txt); "
        "choose another folder with --out, or drive it anew with --overwrite\n"
    )
    assert bytes_of(whole.folder / "stale") == first
    done = whole.run(*run, "--overwrite")
    assert "4 of 4 episodes finished" in done.stdout
    assert bytes_of(whole.folder / "stale") != first
    assert (whole.folder / "stale" / "set_aside" / "1-mine.txt").read_text() == "not the run's"
    assert not (whole.folder / "stale" / "journal.jsonl").exists()
