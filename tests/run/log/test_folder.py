"""Run folders that cannot be used: one clear line, nothing touched."""

from __future__ import annotations

import json
import resource
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from forgeries import change_manifest
from patience import HANG_S
from run_helpers import Bench

RUN = ["run", "--planner", "fake_planners:Good", "--split", "test", "--limit", "4"]


@pytest.mark.parametrize("overwrite", [[], ["--overwrite"]])
def test_a_folder_with_other_things(bench: Bench, overwrite: list[str]) -> None:
    (bench.folder / "mine").mkdir()
    (bench.folder / "mine" / "thesis.txt").write_text("dear")
    done = bench.run(*RUN, "--out", "mine", *overwrite, expect=2)
    assert done.stderr == "error: mine: is neither empty nor a run folder; choose another with --out\n"
    assert [p.name for p in (bench.folder / "mine").iterdir()] == ["thesis.txt"]


def test_a_run_that_goes_on_is_not_overwritten(bench: Bench) -> None:
    process = bench.start_paused(2, *RUN, "--out", "run")
    done = bench.run(*RUN, "--out", "run", "--overwrite", expect=2)
    assert done.stderr == "error: run: another tsbench run is writing here\n"
    bench.go(process)


@pytest.mark.parametrize("overwrite", [[], ["--overwrite"]])
@pytest.mark.parametrize("content", ["{", "[]", '{"contract": "x", "schema_version": 99}'])
def test_a_manifest_that_is_none(bench: Bench, content: str, overwrite: list[str]) -> None:
    (bench.folder / "run").mkdir()
    (bench.folder / "run" / "run.json").write_text(content)
    assert bench.refused(*RUN, "--out", "run", *overwrite).startswith("run/run.json: ")
    assert (bench.folder / "run" / "run.json").read_text() == content


def test_a_folder_that_cannot_be_made(bench: Bench) -> None:
    (bench.folder / "file").write_text("")
    for out in ("file/run", "/proc/run"):
        assert bench.refused(*RUN, "--out", out).startswith(f"{out}: ")


def test_a_read_only_folder(bench: Bench) -> None:
    folder = bench.folder / "locked"
    folder.mkdir()
    folder.chmod(0o555)
    if _writable(folder):
        pytest.skip("this user writes where it may not (root)")
    done = bench.run(*RUN, "--out", "locked", expect=2)
    assert "Permission denied; choose another folder with --out" in done.stderr


def _writable(folder: Path) -> bool:
    try:
        (folder / "x").touch()
    except PermissionError:
        return False
    (folder / "x").unlink()
    return True


def test_a_disk_that_fills_up_loses_nothing(bench: Bench) -> None:
    """No file may grow beyond 10 kB here: the journal reaches that after some episodes."""
    run = [*RUN[:-1], "10", "--trace", "none", "--workers", "1"]
    process = subprocess.run(
        bench.command(*run, "--out", "full"), cwd=bench.folder, env=bench.env, text=True, capture_output=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000)), timeout=HANG_S, check=False,
    )  # fmt: skip
    assert process.returncode == 2
    assert process.stderr.count("\n") == 1
    assert "journal.jsonl: File too large; finished episodes are kept" in process.stderr
    done = bench.run(*run, "--out", "full")
    assert "of 10 episodes are already there" in done.stderr
    bench.run(*run, "--out", "undisturbed")
    for name in ("episodes.parquet", "violations.parquet"):
        assert (bench.folder / "full" / name).read_bytes() == (bench.folder / "undisturbed" / name).read_bytes()


@pytest.fixture
def disk(bench: Bench) -> Iterator[Path]:
    """A disk of 200 kB; skipped where mounting is not permitted."""
    folder = bench.folder / "disk"
    folder.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=200k", "none", str(folder)], capture_output=True, check=False
    )
    if made.returncode:
        pytest.skip("this user may not mount anything")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def remount(disk: Path, options: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{options}", str(disk)], check=True)


def test_a_full_disk_loses_nothing_and_is_continued_when_there_is_room(bench: Bench, disk: Path) -> None:
    run = [*RUN[:-1], "20", "--trace", "all"]
    process = bench.start(*run, "--out", "disk/run", "--workers", "2")
    out, err = process.communicate(timeout=HANG_S)
    assert process.returncode == 2, (out, err)
    assert err.count("\n") == 1
    assert "No space left on device; finished episodes are kept: free some space and run the same" in err
    there = (disk / "run" / "journal.jsonl").read_bytes().count(b"\n") - 1
    assert there > 0
    remount(disk, "size=20m")
    done = bench.run(*run, "--out", "disk/run")
    assert f"continuing: {there} of 20 episodes are already there" in done.stderr
    bench.run(*run, "--out", "undisturbed")
    for name in ("episodes.parquet", "violations.parquet"):
        assert (disk / "run" / name).read_bytes() == (bench.folder / "undisturbed" / name).read_bytes()


def test_a_read_only_disk(bench: Bench, disk: Path) -> None:
    process = bench.start_paused(2, *RUN, "--out", "disk/run")
    process.kill()
    process.communicate()
    before = {path: path.read_bytes() for path in (disk / "run").iterdir() if path.is_file()}
    remount(disk, "ro")
    for out in ("disk/run", "disk/new"):
        told = bench.refused(*RUN, "--out", out)
        assert "Read-only file system; choose another folder with --out" in told
    assert {path: path.read_bytes() for path in before} == before


def test_default_folder_and_manifest(bench: Bench) -> None:
    done = bench.run(*RUN)
    (folder,) = (bench.folder / "runs").iterdir()
    assert folder.name.startswith("Good-test-limit-4-")
    assert sorted(p.name for p in folder.iterdir() if p.suffix) == [
        "episodes.parquet", "run.json", "summary.json", "summary.md", "timing.parquet", "violations.parquet",
    ]  # fmt: skip
    assert f"records   runs/{folder.name}/episodes.parquet" in done.stdout
    # The end of a run is one screen; which contract it has stands last, and in full with the notes below all tables.
    lines, contract = done.stdout.splitlines(), json.loads((folder / "run.json").read_text())["contract"]
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 24
    assert lines[-1].endswith(f", contract {contract[:12]}")
    text = (folder / "summary.md").read_text()
    assert text.endswith(f"Contract `{contract}`.\n")
    assert max(text.rindex("\n| "), text.index("```")) < min(text.index("**Notes: "), text.index("strict: "))


def test_partial_figures_only_when_asked_for(bench: Bench) -> None:
    run = ["run", "--planner", "fake_planners:Slow", "--split", "test", "--workers", "1", "--out", "run"]
    process = bench.start_paused(5, *run, "--allow-partial")
    process.send_signal(signal.SIGINT)
    out, _ = bench.go(process, expect=130)
    assert "PARTIAL" in out
    journal, texts = bench.folder / "run" / "journal.jsonl", ("summary.json", "summary.md")
    assert all("PARTIAL" in (bench.folder / "run" / name).read_text() for name in texts)

    # Continued and interrupted again: the figures of before are not those of the tables that stand there now.
    process = bench.start_paused(len(journal.read_bytes().splitlines()) + 1, *run)
    process.send_signal(signal.SIGINT)
    out, _ = bench.go(process, expect=130)
    assert "PARTIAL" not in out
    assert "summary.md" not in out
    assert not any((bench.folder / "run" / name).exists() for name in texts)


TWO = [*RUN[:-1], "2", "--trace", "all"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, make_data) -> Bench:
    folder = tmp_path_factory.mktemp("bad")
    bench = Bench(make_data(folder / "data"), folder)
    bench.run(*TWO, "--out", "good")
    return bench


@pytest.fixture
def copy(made: Bench) -> Path:
    """A copy of a complete run of two episodes."""
    folder = made.folder / "copy"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(made.folder / "good", folder)
    return folder


COMMANDS = [[*TWO, "--out", "copy"], ["rescore", "copy"], ["compare", "copy", "good"]]


@pytest.mark.parametrize("command", COMMANDS)
def test_an_older_schema(made: Bench, copy: Path, command: list[str]) -> None:
    change_manifest(copy, schema_version=0)
    done = made.run(*command, expect=2)
    assert "copy/run.json: schema version 0, this tsbench reads 1; read it with tsbench 0.1.0" in done.stderr
    assert done.stderr.count("\n") == 1


def test_another_contract_is_refused_compared_with_none_and_judged_with_a_note(made: Bench, copy: Path) -> None:
    change_manifest(copy, contract="f" * 64)
    done = made.run(*COMMANDS[0], expect=2)
    assert "copy: holds another run: contract is ffffffffffff, not " in done.stderr
    done = made.run("compare", "copy", "good", expect=2)
    assert "contract" in done.stderr
    assert done.stderr.count("\n") == 1
    shutil.rmtree(copy / "traces")
    done = made.run("rescore", "copy", expect=1)
    assert "note: the run's contract is ffffffffffff, that of this tsbench " in done.stderr


def test_traces_that_are_torn_gone_or_without_an_episode(made: Bench, copy: Path) -> None:
    torn, gone = sorted((copy / "traces" / "Good").glob("*.parquet"))
    stranger = torn.with_name("nobody.parquet")
    shutil.copy(torn, stranger)
    torn.write_bytes(torn.read_bytes()[:-100])
    gone.unlink()
    done = made.run("rescore", "copy", expect=1)
    assert f"Good {torn.stem}: copy/traces/Good/{torn.name}: cannot be read as a trace" in done.stdout
    assert f"Good {gone.stem}: its trace is gone" in done.stdout
    assert "copy/traces/Good/nobody.parquet: a trace without its episode" in done.stdout
    assert "0 traces judged again, 2 episodes without a trace, disagreements: 3" in done.stdout
    done = made.run(*COMMANDS[0])
    assert "nobody.parquet: does not belong to this run; left alone, not used" in done.stderr
