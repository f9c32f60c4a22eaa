"""Runs from Python: the command's work, its tables as pandas, and errors of one line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

import tsbench
from tsbench.api.runs import Picture, spec_of
from tsbench.core.errors import InputError
from tsbench.planners.idm import Idm
from tsbench.scenarios.spec import CONTRAST

OWN = """
import tsbench
from tsbench.planners.idm import Idm

class Mine(Idm):
    pass

if __name__ == "__main__":
    run = tsbench.evaluate(Mine, types=["yield"], limit=2, workers=1, out="mine")
    print(run.planners, len(run.episodes))
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tsbench.Run:
    out = tmp_path_factory.mktemp("api") / "run"
    return tsbench.evaluate(
        ["idm", "idm-e"], types=["yield", "speed_limit"], variants="0", workers=2, out=out, trace="all"
    )


def test_tables_are_data_frames(run: tsbench.Run) -> None:
    assert run.planners == ("idm", "idm-e")
    episodes = run.episodes
    assert len(episodes) == 8
    assert set(episodes.half) == {"signed", "contrast"}
    broken = run.violations
    assert set(broken.planner) == {"idm"}
    assert broken.sentence.str.len().min() > 20
    assert run.edition.startswith("2026.2")


def test_a_summary_has_each_figure_over_all_groups_and_types(run: tsbench.Run) -> None:
    table = run.summary().set_index(["planner", "figure", "over"])
    assert table.loc[("idm", "paired_scd", "all"), "value"] == 0.0
    assert table.loc[("idm-e", "paired_scd", "all"), "value"] == 100.0
    assert table.loc[("idm", "contrast_scd", "yield"), "value"] == 100.0
    assert set(table.loc["idm", "paired_scd"].index) == {"all", "priority", "speed", "yield", "speed_limit"}


def test_planners_of_a_run_are_compared(run: tsbench.Run) -> None:
    table = run.compare(run, "idm", "idm-e").set_index(["figure", "over"])
    whole = table.loc[("paired_scd", "all")]
    assert (whole.a, whole.b, whole.difference, whole.won, whole.lost) == (0.0, 100.0, 100.0, 2, 0)
    with pytest.raises(InputError, match="has planners idm, idm-e: name one"):
        run.compare(run)


def test_an_episode_is_shown(run: tsbench.Run, tmp_path: Path) -> None:
    name = run.violations.scenario_id[0]
    frame = run.show(f"idm/{name}")
    ((kind, content),) = frame._repr_mimebundle_().items()
    assert (kind, content[:8]) == ("image/png", b"\x89PNG\r\n\x1a\n")
    film = run.show(f"idm/{name}", film=True)
    film.save(tmp_path / "film.gif")
    assert (tmp_path / "film.gif").read_bytes()[:6] == b"GIF89a"
    with pytest.raises(InputError, match="no trace of 'nowhere'"):
        run.show("nowhere")


def test_the_same_call_continues_and_what_is_read_is_the_same(run: tsbench.Run) -> None:
    before = {p.name: p.stat().st_mtime_ns for p in run.path.iterdir()}
    again = tsbench.evaluate(
        ["idm", "idm-e"], types=["yield", "speed_limit"], variants="0", out=run.path, trace="all"
    )
    assert {p.name: p.stat().st_mtime_ns for p in run.path.iterdir()} == before
    assert again.episodes.equals(tsbench.load_run(run.path).episodes)


def test_a_listener_is_told_of_every_episode(tmp_path: Path) -> None:
    class Counts:
        def __init__(self) -> None:
            self.told: list[str] = []

        def notice(self, line: str) -> None:
            self.told.append(line)

        def begin(self, asked: object, done: object) -> None:
            self.told.append(f"begin {asked}")

        def episode(self, row: dict[str, object]) -> None:
            self.told.append(str(row["half"]))

        def end(self) -> None:
            self.told.append("end")

    counts = Counts()
    tsbench.evaluate("idm", types=["yield"], variants="0", workers=1, out=tmp_path / "r", listener=counts)
    assert counts.told == ["begin {'idm': 2}", *sorted(counts.told[1:3]), "end"]
    assert set(counts.told[1:3]) == {"signed", "contrast"}


def test_a_class_of_a_script_is_driven(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)
    done = subprocess.run(
        [sys.executable, "own.py"], cwd=tmp_path, text=True, capture_output=True, check=False, timeout=100
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == "('Mine',) 2\n"


def test_a_class_that_no_other_process_finds_is_one_line() -> None:
    class Inner(Idm):
        pass

    with pytest.raises(InputError, match="write it to a file"):
        spec_of(Inner)
    assert spec_of(Idm).endswith("tsbench/planners/idm.py:Idm")
    assert spec_of("idm") == "idm"


def test_a_picture_knows_its_kind() -> None:
    assert Picture(b"x", "gif")._repr_mimebundle_() == {"image/gif": b"x"}


def test_scenarios_have_scenes_and_networks() -> None:
    both = tsbench.load_scenarios(types=["yield"])
    assert [s.spec.half for s in both].count(CONTRAST) == len(both) / 2
    one = tsbench.load_scenarios(types=["yield"], half="signed")[0]
    assert one.scene.target_sign.code == "2.4"
    assert one.network.lanes
    with pytest.raises(InputError, match="no such type"):
        tsbench.load_scenarios(types=["fly"])


def test_importing_the_package_brings_nothing_heavy() -> None:
    code = "import sys, tsbench; print(sorted({'numpy', 'pandas', 'pyarrow', 'libsumo'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True, check=True)
    assert done.stdout == "[]\n"
