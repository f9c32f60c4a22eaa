"""Run folders of another contract, of an older schema, torn or with strangers: what each command says of them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from run_helpers import Bench

RUN = ["run", "--planner", "fake_planners:Good", "--split", "test", "--trace", "all", "--limit", "2"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, make_data) -> Bench:
    folder = tmp_path_factory.mktemp("bad")
    bench = Bench(make_data(folder / "data"), folder)
    bench.run(*RUN, "--out", "good")
    return bench


@pytest.fixture
def copy(made: Bench) -> Path:
    """A copy of a complete run of two episodes."""
    folder = made.folder / "copy"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(made.folder / "good", folder)
    return folder


COMMANDS = [[*RUN, "--out", "copy"], ["rescore", "copy"], ["compare", "copy", "good"]]


def change_manifest(folder: Path, **changes: object) -> None:
    path = folder / "run.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


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
