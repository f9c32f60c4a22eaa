"""Without the train split's scenes and the oracle's tables, which do not come with the package: one line says how."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from command_line import in_process, refused
from data_folder import in_force

from tsbench.core.errors import InputError
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.scenarios.data_set import DataSet

ROOT = Path(__file__).resolve().parents[2]
SCENES = "no such scene files (tsbench data fetch --from DIR|URL train)"
ORACLE = "oracle.parquet: no such table (tsbench data fetch --from DIR|URL oracle brings"


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tables of the train split with the rows of one type, which are read in no time."""
    folder = tmp_path_factory.mktemp("tables")
    for name in ("train", "certificates"):
        found = pq.read_table(ROOT / "scenarios" / f"{name}.parquet")
        of_type = pc.starts_with(found["scenario_id"], "yield-j-")
        in_split = pc.equal(found["split"], "train")
        pq.write_table(found.filter(pc.and_(of_type, in_split)), folder / f"{name}.parquet")
    return folder


@pytest.fixture
def lacking(tables: Path, tmp_path: Path) -> Iterator[Path]:
    """A data folder with tables of scenarios, and a folder to work in."""
    root = tmp_path / "data"
    (root / "scenarios").mkdir(parents=True)
    for name in ("sign_catalog", "sumo_nets"):
        (root / name).symlink_to(ROOT / name)
    for path in tables.iterdir():
        (root / "scenarios" / path.name).symlink_to(path)
    with in_force(root) as patch:
        patch.chdir(tmp_path)
        yield tmp_path


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("run --planner idm --split train --limit 2 --out out", SCENES),
        ("scenarios show yield-j-dol-0128fe0d7b-v0", SCENES),
        ("scenarios open yield-j-dol-0128fe0d7b-v0", SCENES),
        ("scenarios certify --types yield", SCENES),
        ("oracle collect --limit 1 --out out", SCENES),
        pytest.param("train ppo --out out", SCENES, marks=pytest.mark.slow),
        pytest.param("train plant2 --out out", SCENES, marks=pytest.mark.slow),
        pytest.param("train plant2-ft --planner idm-e --out out", SCENES, marks=pytest.mark.slow),
        ("oracle stats", ORACLE),
        ("oracle verify", ORACLE),
    ],
)
def test_a_command_says_how_to_get_it(
    lacking: Path, capsys: pytest.CaptureFixture[str], command: str, words: str
) -> None:
    name, *arguments = command.split()
    told = refused(in_process(name, capsys), *arguments)
    assert words in told
    assert str(lacking / "data" / "scenarios") in told
    assert not (lacking / "out").exists()


@pytest.mark.slow
def test_fine_tuning_without_the_oracle(lacking: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (lacking / "data" / "scenarios" / "scenes").symlink_to(ROOT / "scenarios" / "scenes")
    for command in ("plant2-ft", "frames"):
        assert ORACLE in refused(in_process("train", capsys), command, "--out", "out")


def test_a_split_that_a_city_does_not_have(monkeypatch: pytest.MonkeyPatch) -> None:
    """No command brings it: the line names the splits that are there."""
    monkeypatch.setenv("TSBENCH_CITY", "andorra")
    there = ", ".join(DataSet.driven().splits)
    assert "train" not in there
    with pytest.raises(InputError, match=f"train.parquet: andorra has no train split; it has {there}$"):
        DriveEnv()


def test_an_environment_of_the_train_split(lacking: Path) -> None:
    with pytest.raises(InputError, match="no such scene files"):
        DriveEnv(split="train")
