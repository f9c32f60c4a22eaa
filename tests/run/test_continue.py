"""Killed at any moment and continued, with any number of workers: the same bytes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import pytest
from run_helpers import Bench, assert_gone, workers_of

from tsbench.run.tables import read_table
from tsbench.scenarios.table import read_table as read_scenarios
from tsbench.scenarios.table import write_table

RUN = ["run", "--planner", "fake_planners:Slow", "--planner", "fake_planners:Raises", "--split", "test"]
TABLES = ("episodes.parquet", "violations.parquet")


def bytes_of(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in TABLES]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory, make_data) -> Bench:
    """A data folder with an undisturbed run by one worker in it."""
    folder = tmp_path_factory.mktemp("whole")
    bench = Bench(make_data(folder / "data"), folder)
    bench.run(*RUN, "--out", "whole", "--workers", "1", expect=1)
    return bench


def wait_for_lines(folder: Path, lines: int, process: subprocess.Popen[str]) -> None:
    journal = folder / "journal.jsonl"
    end = time.monotonic() + 40
    while time.monotonic() < end and process.poll() is None:
        if journal.exists() and journal.read_bytes().count(b"\n") >= lines:
            return
        time.sleep(0.01)
    raise AssertionError(f"the run did not come to {lines} episodes: {process.communicate(timeout=5)}")


def test_two_workers_and_another_hash_seed(whole: Bench) -> None:
    process = whole.start(*RUN, "--out", "two", "--workers", "2", PYTHONHASHSEED="77")
    process.communicate(timeout=60)
    assert process.returncode == 1
    assert bytes_of(whole.folder / "two") == bytes_of(whole.folder / "whole")


def test_killed_three_times_and_continued(whole: Bench) -> None:
    folder = whole.folder / "killed"
    for lines in (1, 20, 45):
        process = whole.start(*RUN, "--out", "killed", "--workers", "2")
        wait_for_lines(folder, lines, process)
        workers = workers_of(process)
        assert workers
        process.kill()
        process.wait()
        assert_gone(workers)
        assert json.loads((folder / "run.json").read_text())["status"] == "running"
    done = whole.run(*RUN, "--out", "killed", "--workers", "2", expect=1)
    assert "are already there" in done.stderr
    assert bytes_of(folder) == bytes_of(whole.folder / "whole")
    assert len(json.loads((folder / "run.json").read_text())["sessions"]) == 4


def test_a_worker_killed_is_replaced(whole: Bench) -> None:
    process = whole.start(*RUN, "--out", "worker", "--workers", "2")
    for lines in (5, 30):
        wait_for_lines(whole.folder / "worker", lines, process)
        os.kill(workers_of(process)[0], signal.SIGKILL)
    process.communicate(timeout=60)
    assert process.returncode == 1
    assert bytes_of(whole.folder / "worker") == bytes_of(whole.folder / "whole")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_interrupted_keeps_what_is_finished(whole: Bench, number: signal.Signals) -> None:
    name = f"stopped-{number}"
    process = whole.start(*RUN, "--out", name, "--workers", "2")
    wait_for_lines(whole.folder / name, 10, process)
    workers = workers_of(process)
    process.send_signal(number)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "Traceback" not in err
    assert "run the same command again to continue" in out
    assert_gone(workers)
    manifest = json.loads((whole.folder / name / "run.json").read_text())
    assert manifest["status"] == "interrupted"
    episodes = read_table(whole.folder / name / "episodes.parquet")
    assert len(episodes) == manifest["counts"]["finished"]
    assert 10 <= manifest["counts"]["finished"] < 80
    assert not (whole.folder / name / "summary.json").exists()


def test_a_torn_journal_and_foreign_files_are_named(whole: Bench) -> None:
    folder = whole.folder / "torn"
    process = whole.start(*RUN, "--out", "torn", "--workers", "1")
    wait_for_lines(folder, 6, process)
    process.kill()
    process.wait()
    with (folder / "journal.jsonl").open("rb+") as file:
        file.truncate((folder / "journal.jsonl").stat().st_size - 100)
    (folder / "notes.txt").write_text("mine")
    (folder / "traces" / "Slow").mkdir(parents=True, exist_ok=True)
    (folder / "traces" / "Slow" / "stranger.parquet").write_text("mine too")
    (folder / "traces" / "Slow" / ".half.parquet.123.tmp").write_text("half")
    done = whole.run(*RUN, "--out", "torn", "--workers", "1", expect=1)
    for words in (
        "torn or foreign lines moved to",
        "notes.txt: does not belong",
        "stranger.parquet: does not",
    ):
        assert words in done.stderr
    assert (folder / "notes.txt").read_text() == "mine"
    assert (folder / "traces" / "Slow" / "stranger.parquet").read_text() == "mine too"
    assert (folder / "aside" / "half.parquet.123.tmp-1").read_text() == "half"
    assert (folder / "aside" / "journal-1.txt").exists()
    assert bytes_of(folder) == bytes_of(whole.folder / "whole")


def test_a_complete_run_is_shown_and_not_run_again(whole: Bench) -> None:
    before = {p: p.stat().st_mtime_ns for p in sorted((whole.folder / "whole").rglob("*"))}
    done = whole.run(*RUN, "--out", "whole", expect=1)
    assert "80 of 80 episodes finished" in done.stdout
    assert {p: p.stat().st_mtime_ns for p in sorted((whole.folder / "whole").rglob("*"))} == before


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (["--limit", "3"], "limit is null, not 3"),
        (["--mask-signs"], "mask_signs is false, not true"),
        (["--planner", "fake_planners:Good"], "planners are"),
    ],
)
def test_another_run_in_the_folder(whole: Bench, change: list[str], words: str) -> None:
    done = whole.run(*RUN, *change, "--out", "whole", expect=2)
    assert done.stderr.startswith("error: whole: holds another run: ")
    assert words in done.stderr
    assert done.stderr.count("\n") == 1


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
