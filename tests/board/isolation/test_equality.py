"""An isolated planner drives as the same one beside the referee does, byte for byte."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

import tsbench
from tsbench.board.isolation import isolated_loading as loading
from tsbench.board.isolation import protocol
from tsbench.board.isolation.isolated_loading import describe
from tsbench.board.submission import SubmittedEpisode, episode_of
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.planners import registry
from tsbench.run.log.journal import read_table
from tsbench.run.planner_info import code_hash_of
from tsbench.run.planner_info import describe as describe_here

ROOT = Path(tsbench.__file__).parent.parent
PLANNERS = ["idm", "idm-e", "ppo"]


def digests(folder: Path) -> dict[str, SubmittedEpisode]:
    events: dict[tuple[str, str], list[dict[str, object]]] = {}
    for event in read_table(folder / "violations.parquet").to_pylist():
        events.setdefault((event["planner"], event["scenario_id"]), []).append(event)
    rows = read_table(folder / "episodes.parquet").to_pylist()
    return {
        f"{row['planner']} {row['scenario_id']}": episode_of(row, events.get((row["planner"], row["scenario_id"]), ()))
        for row in rows
    }


@pytest.mark.slow
def test_digests_are_those_of_a_run_in_one_process(tmp_path: Path) -> None:
    kinds = ("yield", "crosswalk", "detour_either", "speed_limit", "no_entry")
    for name, isolate in (("together", False), ("apart", True)):
        tsbench.evaluate(PLANNERS, split="dev", types=kinds, limit=10, workers=1, isolate=isolate, out=tmp_path / name)
    together, apart = digests(tmp_path / "together"), digests(tmp_path / "apart")
    assert len(together) >= 27
    assert len({episode.digest for episode in together.values()}) > 20
    assert apart == together
    for told in json.loads((tmp_path / "apart" / "run.json").read_text())["isolation"].values():
        assert told["namespaces"].startswith("bubblewrap ")


@pytest.mark.parametrize("spec", [*PLANNERS, f"{ROOT}/examples/minimal_planner.py:Minimal"])
def test_a_planner_is_what_it_is_in_one_process(spec: str) -> None:
    here = describe_here(spec)
    told = describe(spec).planner
    assert told == replace(here, served_on=(), files=told.files)
    assert bool(told.files) is (told.code_sha256 is not None)


def test_a_planner_cannot_say_what_its_code_is(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("class P:\n    def reset(self, c): pass\n    def act(self, o): pass\n")
    before = code_hash_of(f"{file}:P")
    file.write_text(file.read_text() + "import tsbench.core.provenance as p\np.digest = lambda _: '0' * 64\n")
    assert describe(f"{file}:P").planner.code_sha256 not in (before, "0" * 64)


def test_a_planner_cannot_say_what_its_weights_are(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "import tsbench.board.isolation.protocol as c\n"
        "told = c.HelloMessage\n"
        "def lies(*facts, **more):\n"
        "    hello = told(*facts, **more)\n"
        "    hello.name, hello.weights_file = 'liar', 'mine.py'\n"
        "    return hello\n"
        "c.HelloMessage = lies\n"
        "class P:\n    def reset(self, c): pass\n    def act(self, o): pass\n"
    )
    liar = describe(f"{file}:P").planner
    assert (liar.name, liar.weights_sha256) == ("liar", None)


def test_weights_are_hashed_in_their_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = registry.entry("ppo")
    file = tmp_path / entry.weights.file
    file.write_bytes(b"others")
    monkeypatch.setattr(loading, "file_of", lambda _: file)
    assert loading.weights_hash("ppo", None) == loading.weights_hash("ppo-e", "odd") == sha256_of(file)
    assert loading.weights_hash("idm", "odd") is None
    # One that another package registers says which file; whether it is there, and what is in it, is seen from here.
    monkeypatch.setattr(loading, "source_of", lambda _: "other.planners")
    monkeypatch.setattr(loading, "source_places", lambda _: [tmp_path])
    assert loading.weights_hash("theirs", entry.weights.file) == sha256_of(file)
    assert loading.weights_hash("theirs", "none.pt") is loading.weights_hash("theirs", None) is None


def test_a_program_is_hashed_as_its_file(tmp_path: Path) -> None:
    file = tmp_path / "program"
    file.write_bytes(b"1")
    file.chmod(0o755)
    before = code_hash_of(f"exe:{file}")
    file.write_bytes(b"2")
    assert before != code_hash_of(f"exe:{file}") == sha256_of(file)


def test_what_does_not_come_up_says_why(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("1 / 0\n")
    with pytest.raises(InputError, match="ZeroDivisionError"):
        describe(f"{file}:P")
    with pytest.raises(InputError, match="no file that can be executed"):
        describe(f"exe:{file}")


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) here")
def test_a_planner_in_c_drives(tmp_path: Path) -> None:
    binary = tmp_path / "follow_route"
    source = ROOT / "examples" / "follow_route.c"
    subprocess.run(["cc", "-O2", "-Wall", "-Werror", "-o", str(binary), str(source), "-lm"], check=True)
    tsbench.evaluate(f"exe:{binary}", split="dev", limit=4, workers=1, isolate=True, out=tmp_path / "run", trace="none")
    rows = read_table(tmp_path / "run" / "episodes.parquet").to_pylist()
    assert [row["outcome"] for row in rows].count("arrived") >= 2
    assert json.loads((tmp_path / "run" / "run.json").read_text())["planners"][0]["name"] == "follow_route"


def test_an_executable_runs_isolated_only(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="isolate"):
        tsbench.evaluate("exe:/bin/true", split="dev", limit=2, out=tmp_path / "run")


def test_the_published_schema_is_that_of_the_code() -> None:
    stored = json.loads((ROOT / "docs" / "isolation.schema.json").read_text(encoding="utf-8"))
    assert stored == json.loads(json.dumps(protocol.schema()))
