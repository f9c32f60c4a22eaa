"""The doctor: what it finds on this machine, and that it finds what is broken."""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import in_process
from data_folder import in_force

from tsbench.cli import diagnosis
from tsbench.cli.diagnosis import REPAIR, Diagnosis, Status, alone, check_packages, judge_packages, locked
from tsbench.core.errors import InputError
from tsbench.scenarios.data_set import read_table, write_table
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.store import SceneStore, store_path, write_store

ROOT = Path(__file__).resolve().parents[2]
ASKED = ("numpy>=2.0", "pyarrow>=23,<24", 'torch>=2.4; extra == "learn"')


def failed(findings: Iterator[Diagnosis]) -> list[str]:
    return [finding.text for finding in findings if finding.status is Status.FAILED]


def test_packages_of_this_installation_are_there() -> None:
    assert not failed(check_packages())


def test_packages_that_lack_or_are_too_new() -> None:
    there = {"numpy": "2.1", "pyarrow": "24.0"}
    first, extra = judge_packages(ASKED, (), there)
    assert (first.status, first.text) == (Status.FAILED, "not as required: pyarrow 24.0 (<24,>=23)")
    assert first.remedy == REPAIR
    assert extra.status is Status.NOTE
    assert extra.text == "extra learn (for train, the Gymnasium environments): lacks torch (not there)"
    (lacking, _) = judge_packages(ASKED, (), {"pyarrow": "23.1"})
    assert lacking.text == "not as required: numpy (not there)"


def test_an_installation_lists_the_extras_of_the_page_and_a_clone_all() -> None:
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    asked = [f'{name}; extra == "{name}"' for name in declared]
    users, developers = ([d.text for d in judge_packages(asked, pins, {})][1:] for pins in ((), ("numpy==2.0",)))
    page = (ROOT / "docs/install.md").read_text(encoding="utf-8").partition("## Extras")[2].partition("## More")[0]
    assert [text.split()[1] for text in users] == sorted(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    assert [text.split()[1] for text in developers] == sorted(declared)
    assert set(developers) >= set(users)
    assert "extra dev (for developers): lacks dev (not there)" in developers


def test_other_versions_than_the_pinned_are_a_note() -> None:
    there = {"numpy": "2.1", "pyarrow": "23.0", "torch": "2.13.0+cpu"}
    pins = locked(
        "# a comment\npyarrow==23.0.1 \\\n    --hash=sha256:00\ntorch==2.13.0 ; python_version > '3' \\\n"
        "elsewhere==1.0\n"
        "numpy==2.0 ; python_version < '3' \\\n    # via scipy\n"
    )
    found = list(judge_packages(ASKED, pins, there))
    assert not failed(iter(found))
    assert found[-1].text.endswith("known to work together: pyarrow 23.0 instead of ==23.0.1")


def _store(rows: list[ScenarioSpec], root: Path, names: dict[str, str] | None = None) -> None:
    """The files of rows of one map in a store below `root`; names: other names for some of them, "" = not at all."""
    committed, named = SceneStore(ROOT / "scenarios"), {}
    for row in rows:
        for name in (row.net, row.additional):
            named[(names or {}).get(name, name)] = committed.read(row, name).content
    named.pop("", None)
    write_store([(rows[0].map_id, named)], store_path("test", rows[0].scenario_type, root))


@pytest.fixture
def copy(tmp_path: Path) -> Iterator[Path]:
    """A data folder with three scenarios of the real test split."""
    root = tmp_path / "data"
    (root / "scenarios").mkdir(parents=True)
    for name in ("sign_catalog", "sumo_nets"):
        (root / name).symlink_to(ROOT / name)
    rows = read_table(ROOT / "scenarios" / "test.parquet")[:3]
    write_table(rows, root / "scenarios" / "test.parquet")
    _store(rows, root / "scenarios")
    with in_force(root):
        yield root / "scenarios"


def test_data_that_is_whole_and_a_split_that_is_not_there(copy: Path) -> None:
    found = list(diagnosis.check_data())
    assert not failed(iter(found))
    assert any("test.parquet: 3 scenarios, all " in finding.text for finding in found)
    (train,) = (finding for finding in found if "train" in finding.text)
    assert train.status is Status.NOTE
    assert train.remedy == "needed for --split train only: tsbench data fetch --from DIR|URL train"


def test_scene_files_that_are_missing_or_changed(copy: Path) -> None:
    rows = read_table(copy / "test.parquet")
    first, second, _ = rows
    path = store_path("test", first.scenario_type, copy)
    _store(rows, copy, {first.additional: second.additional, second.additional: first.additional})
    (text,) = failed(diagnosis.check_data())
    assert "0 scene files missing, 2 of 4 hashed ones changed" in text
    assert text.endswith(f"first {path / first.additional}")
    _store(rows, copy, {second.additional: ""})
    (text,) = failed(diagnosis.check_data())
    assert "1 scene files missing" in text
    assert text.endswith(f"first {path / second.additional}")


@pytest.mark.parametrize(("split", "status"), [("test", Status.FAILED), ("train", Status.NOTE)])
def test_scenes_that_were_not_fetched(copy: Path, split: str, status: Status) -> None:
    rows = [replace(row, split=split) for row in read_table(copy / "test.parquet")]
    shutil.rmtree(copy / "scenes")
    (copy / "test.parquet").unlink()
    write_table(rows, copy / f"{split}.parquet")
    (found,) = (finding for finding in diagnosis.check_data() if "no scene files here" in finding.text)
    assert (found.status, found.remedy) == (status, f"tsbench data fetch --from DIR|URL {split}")


def test_a_table_that_cannot_be_read_is_one_finding(copy: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (copy / "test.parquet").write_bytes(b"PAR1")
    monkeypatch.setattr(diagnosis, "CHECKS", {"data": diagnosis.check_data})
    (text,) = failed(diagnosis.examine())
    assert "test.parquet: not a readable Parquet table" in text


def test_a_package_that_lacks_does_not_stop_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> Iterator[Diagnosis]:
        raise ImportError("No module named 'pyarrow'")
        yield

    def sound() -> Iterator[Diagnosis]:
        yield Diagnosis(Status.OK, "b", "fine")

    def torn() -> Iterator[Diagnosis]:
        raise InputError("file: torn")
        yield

    monkeypatch.setattr(diagnosis, "CHECKS", {"a": broken, "b": sound, "c": torn})
    found = list(diagnosis.examine())
    assert [finding.status for finding in found] == [Status.FAILED, Status.OK, Status.FAILED]
    assert "No module named 'pyarrow'" in found[0].text
    assert (found[2].name, found[2].text) == ("c", "file: torn")


def test_a_simulation_starts() -> None:
    (finding,) = diagnosis.check_sumo()
    assert finding.status is Status.OK, finding.text
    assert "a simulation started" in finding.text


def test_sumo_that_dies_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis, "alone", lambda code: (-11, "killed by signal 11"))
    (finding,) = diagnosis.check_sumo()
    assert finding.status is Status.FAILED
    assert "a simulation does not start: killed by signal 11" in finding.text
    monkeypatch.setattr(diagnosis, "installed", lambda names: {"libsumo": "1.28.0", "sumolib": "1.27.0"})
    (finding,) = diagnosis.check_sumo()
    assert "its packages do not belong together: libsumo 1.28.0, sumolib 1.27.0" in finding.text


@pytest.mark.parametrize(
    ("code", "ending"),
    [
        ("print('a'); print('b')", (0, "b")),
        ("import sys; sys.exit('torn: x')", (1, "torn: x")),
        ("import os; os.abort()", (-6, "killed by signal 6")),
        ("pass", (0, "no words")),
    ],
)
def test_code_in_a_process_of_its_own(code: str, ending: tuple[int, str]) -> None:
    assert alone(code) == ending


def test_little_memory_and_disk_are_notes(monkeypatch: pytest.MonkeyPatch) -> None:
    assert not failed(diagnosis.check_machine())
    monkeypatch.setattr(diagnosis, "_free_memory", lambda: 2**20)
    monkeypatch.setattr(diagnosis.shutil, "disk_usage", lambda path: shutil._ntuple_diskusage(2, 1, 2**20))
    cores, memory, disk = diagnosis.check_machine()
    assert (cores.status, memory.status, disk.status) == (Status.OK, Status.NOTE, Status.NOTE)
    assert "--workers" in memory.remedy
    assert "--out" in disk.remedy


def test_an_old_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnosis.sys, "version_info", (3, 10, 2))
    (finding,) = diagnosis.check_python()
    assert (finding.status, finding.remedy) == (Status.FAILED, "install Python 3.11 or later")


@pytest.mark.parametrize(
    ("status", "code", "last"), [(Status.NOTE, 0, "nothing is in the way"), (Status.FAILED, 1, "failed: 1")]
)
def test_findings_and_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], status: Status, code: int, last: str
) -> None:
    def check() -> Iterator[Diagnosis]:
        yield Diagnosis(Status.OK, "Python", "fine")
        yield Diagnosis(status, "data", "a file [b]is[/b] gone", "bring it back")

    monkeypatch.setattr(diagnosis, "CHECKS", {"all": check})
    lines = in_process("doctor", capsys)(expect=code)[0].splitlines()
    assert lines[0].split() == ["ok", "Python", "fine"]
    assert "a file [b]is[/b] gone" in lines[1]
    assert lines[2].strip() == "-> bring it back"
    assert lines[3] == last
