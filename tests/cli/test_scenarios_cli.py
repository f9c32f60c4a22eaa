"""`tsbench scenarios` on a small data folder: what it prints, and one line for what is wrong."""

from __future__ import annotations

import csv
import gzip
import importlib
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import in_process, refused
from data_folder import in_force

from tsbench.make.scenes.traffic import Car
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import read_network
from tsbench.scenarios.certificates import Certificate, bases, certificates_path, write_certificates
from tsbench.scenarios.data_set import read_table, write_table
from tsbench.scenarios.map_pool import write_pool
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.scene import EgoStart

ROOT = Path(__file__).resolve().parents[2]
# The hand-made scenes and pool rows are shared with the tests of the simulation and of scenarios.
world = importlib.import_module("simworld")
pool_builders = importlib.import_module("pool_builders")
Run = Callable[..., str]


@pytest.fixture(scope="module")
def made_data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two maps, one of them test; three rows each."""
    root = tmp_path_factory.mktemp("data")
    folder, built = root / "scenarios", root / "built"
    shutil.copytree(ROOT / "scenarios" / "recipes", folder / "recipes")
    built.mkdir()
    (root / "sign_catalog").symlink_to(ROOT / "sign_catalog")
    (root / "sumo_nets").mkdir()
    maker = world.SceneMaker.over(world.cross_plain(), built, "cross")
    sign = world.plate(maker.network, "s_in", 139.0, "2.4", junction="x", approach="s_in", main_in="w_in e_in")
    start, way = EgoStart("s_in_0", 60.0, 7.75), ("s_in", "n_out")
    rows: dict[str, list[ScenarioSpec]] = {"train": [], "test": []}
    for split in rows:
        for k in range(3):
            spec = maker.make(f"yield-j-{split}-v{k}", start, Destination("n_out", 60.0), way, sign)
            rows[split].append(replace(spec, map_id=f"j-{split}", split=split, variant=k))
        write_table(rows[split], folder / f"{split}.parquet")
        world.store_scenes(rows[split], built, folder)
    pool = [pool_builders.crossroads("j-train", east=0.0), pool_builders.crossroads("j-test", east=5000.0)]
    write_pool(pool, root / "sumo_nets" / "pool.parquet")
    (folder / "build_report.json").write_text(
        '[{"type_id": "yield", "split": "test", "maps": {}, "missed": {"X": 3}, "short": 0,'
        ' "reasons": {"the secondary arm is … m long": 7}}]'
    )
    every = [spec for split in rows.values() for spec in split]
    of = bases(every)
    write_certificates([certificate(spec, of[spec.scenario_id]) for spec in every], certificates_path(folder))
    return root


def certificate(spec: ScenarioSpec, basis: str = "", density: float = 0.0) -> Certificate:
    """One that says what it is of, and that nobody solves it."""
    return Certificate(
        spec.scenario_id, spec.scenario_type, spec.split, 0, "", 1.0, "idm", "arrived", False, False, density, density,
        0, 0, 0.0, "", "", basis, 1, None,
    )  # fmt: skip


@pytest.fixture
def data(made_data: Path, tmp_path: Path) -> Iterator[Path]:
    """A copy in force for one test, which may break it."""
    root = tmp_path / "data"
    shutil.copytree(made_data, root, symlinks=True)
    with in_force(root) as patch:
        patch.setenv("COLUMNS", "200")
        yield root


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command of `tsbench scenarios`: what it prints, or the line with which it refuses."""
    command = in_process("scenarios", capsys)

    def run(*arguments: str, expect: int = 0) -> str:
        return refused(command, *arguments) if expect == 2 else command(*arguments, expect=expect)[0]

    return run


def test_list(data: Path, run: Run) -> None:
    lines = run("list").split()
    assert lines == [f"yield-j-{s}-v{k}" for s in ("test", "train") for k in range(3)]
    assert run("list", "--split", "test").split() == lines[:3]
    assert run("list", "--types", "speed_limit") == ""


def test_show(data: Path, run: Run, tmp_path: Path) -> None:
    told = run("show", "yield-j-test-v1")
    for words in ("yield-j-test-v1", "2.4 (target) on s_in", "s_in > n_out", "the same", "7.75"):
        assert words in told
    picture = tmp_path / "scene.png"
    assert str(picture) in run("show", "yield-j-test-v1", "--png", str(picture)).replace("\n", "")
    assert picture.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_open_prints_a_command_on_files_that_are_there(data: Path, run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "files"
    said, command = run("open", "yield-j-test-v1", "--out", str(folder)).splitlines()
    words = command.split()
    assert words[0] == "sumo-gui"
    net, additional = Path(words[words.index("-n") + 1]), Path(words[words.index("-a") + 1])
    assert said == f"scene: {net} and {additional}"
    assert {net, additional} == set(folder.iterdir())
    assert net.read_bytes() == gzip.decompress((data / "built" / "cross.net.xml.gz").read_bytes())
    assert b'id="sign_0"' in additional.read_bytes()
    (tmp_path / "taken").touch()
    assert "cannot be written here" in run("open", "yield-j-test-v1", "--out", str(tmp_path / "taken" / "in"), expect=2)


def test_lint_counts_plates_by_kind_of_place(data: Path, run: Run) -> None:
    assert "3 rows, 0 findings" in run("lint", "--split", "test")
    net = data / "built" / "cross.net.xml.gz"
    maker = world.SceneMaker(data / "built", net, read_network(net))
    far = world.plate(maker.network, "s_in", 60.0, "2.4", junction="x", approach="s_in", main_in="w_in e_in")
    start, end = EgoStart("s_in_0", 30.0, 7.75), Destination("n_out", 60.0)
    spec = maker.make("yield-j-test-v0", start, end, ("s_in", "n_out"), far)
    rows = [replace(spec, map_id="j-test", split="test")]
    write_table(rows, data / "scenarios" / "test.parquet")
    world.store_scenes(rows, data / "built", data / "scenarios")
    told = run("lint", "--split", "test", "--each", "1", expect=1)
    assert "yield-j-test-v0: sign_0 (2.4, target): line: stands 83 m before the line, at most 26 m" in told
    assert re.search(r"line +2\.4 +1 +1 +1", told)
    assert "1 rows, 1 findings" in told


def test_verify_sound_rows(data: Path, run: Run) -> None:
    assert "6 rows, 0 problems" in run("verify")
    assert "3 rows, 0 problems" in run("verify", "--split", "test")


def test_verify_names_every_problem_and_exits_with_1(data: Path, run: Run) -> None:
    folder = data / "scenarios"
    rows = read_table(folder / "test.parquet")
    (data / "built" / "yield-j-test-v2.add.xml.gz").write_bytes(b"<additional/>")
    world.store_scenes(rows[1:], data / "built", folder)
    table = folder / "train.parquet"
    rows = read_table(table)
    write_table([replace(rows[0], scenario_type="fly"), *rows[1:]], table)
    told = run("verify", expect=1)
    assert "yield-j-test-v0: " in told
    assert "no such scene file" in told
    assert "SHA-256 differs" in told
    assert "yield-j-train-v0: unknown scenario type 'fly'" in told
    # What the first row is now is not what its certificate is of.
    assert "yield-j-train-v0: its certificate is of another row or SUMO" in told
    assert "6 rows, 4 problems" in told


def test_verify_finds_maps_that_are_too_near_in_both_splits_or_nowhere(data: Path, run: Run) -> None:
    pool = data / "sumo_nets" / "pool.parquet"
    write_pool([pool_builders.crossroads("j-train"), pool_builders.crossroads("j-test", east=400.0)], pool)
    assert "j-train: is within 300 m of test map j-test" in run("verify", expect=1)
    write_pool([pool_builders.crossroads("j-train"), pool_builders.crossroads("j-test", east=421.0)], pool)
    run("verify")
    table = data / "scenarios" / "test.parquet"
    write_table([replace(r, place="j-other") for r in read_table(table)], table)
    assert "j-test: is of place j-test" in run("verify", expect=1)
    write_pool([pool_builders.crossroads("j-train")], pool)
    assert "j-test: map is not in the pool" in run("verify", expect=1)
    write_table([replace(r, map_id="j-train") for r in read_table(table)], table)
    assert "j-train: map is in two splits" in run("verify", expect=1)


def test_stats(data: Path, run: Run) -> None:
    (data / "cities").mkdir()
    (data / "cities" / "moscow.yaml").symlink_to(ROOT / "cities" / "moscow.yaml")
    told = run("stats")
    assert "yield" in told
    assert "X 1" in told
    assert "7 the secondary arm is … m long" in told
    assert "X 3" in told


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["show", "yield-nowhere-v0"], "no scenario 'yield-nowhere-v0'"),
        (["open", "yield-nowhere-v0"], "no scenario 'yield-nowhere-v0'"),
        (["list", "--split", "exam"], "exam"),
        (["build", "--types", "fly", "--osm", "."], "fly"),
        (["build", "--workers", "0"], "workers"),
    ],
)
def test_wrong_usage_is_one_line(data: Path, run: Run, arguments: list[str], words: str) -> None:
    assert words in run(*arguments, expect=2)


def test_a_missing_or_broken_table_is_one_line(data: Path, run: Run) -> None:
    table = data / "scenarios" / "train.parquet"
    table.write_bytes(table.read_bytes()[:200])
    for command in ("list", "verify", "stats"):
        assert f"{table}: not a readable Parquet table" in run(command, expect=2)
    table.unlink()
    assert run("list").split() == [f"yield-j-test-v{k}" for k in range(3)]
    (data / "scenarios" / "test.parquet").unlink()
    assert "no such table (tsbench data fetch --from DIR|URL test brings" in run("list", expect=2)


def test_a_missing_pool_and_report(data: Path, run: Run) -> None:
    report = data / "scenarios" / "build_report.json"
    report.write_text("{")
    assert "cannot be read as a build report" in run("stats", expect=2)
    report.unlink()
    assert "no build report" in run("stats", expect=2)
    (data / "sumo_nets" / "pool.parquet").unlink()
    assert "maps harvest" in run("verify", expect=2)
    assert "maps harvest" in run("build", "--osm", ".", expect=2)


@pytest.fixture
def traffic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A nominal row, and one with traffic."""
    root = tmp_path / "data" / "scenarios"
    root.mkdir(parents=True)
    (tmp_path / "data" / "sign_catalog").symlink_to(ROOT / "sign_catalog")
    shutil.copy(ROOT / "scenarios" / "nuplan_statistics.json", root)
    maker = world.SceneMaker.over(world.road_plain(), root)
    cars = [Car(f"bg_{k}", 0, 0.0, ("road",), k, 100.0) for k in range(3)]
    rows = [
        maker.make(
            f"row{k}", EgoStart("road_0", 20.0, 8.0), Destination("road", 280.0), ("road",),
            world.speed_plate(maker.network, "road", 200.0), cars=cars,
        )
        for k in range(2)
    ]  # fmt: skip
    rows[1] = replace(rows[1], variant=1, density=4.0)
    write_table(rows, root / "test.parquet")
    world.store_scenes(rows, root, root)
    write_certificates([certificate(rows[0]), certificate(rows[1], density=13.3)], certificates_path(root))
    # The one simulation of this process is lent to the command.
    monkeypatch.setattr("tsbench.sim.sumo.Simulation", lambda: world.simulation())
    monkeypatch.setattr(world.simulation(), "close", lambda: None)
    with in_force(tmp_path / "data") as patch:
        patch.setenv("COLUMNS", "200")
        yield root


def test_prints_distances_and_draws(traffic: Path, tmp_path: Path, run: Run) -> None:
    out = tmp_path / "out"
    told = run("calibration", "--split", "test", "--out", str(out))
    for quantity, n in (("initial speed", 1), ("density", 1)):
        (line,) = [x for x in told.splitlines() if quantity in x]
        assert f" {n} " in line
        assert "missed" in line  # one value is no distribution
    (line,) = [x for x in told.splitlines() if "cruise speed" in x]
    assert "no goal" in line
    assert (out / "calibration.png").read_bytes()[:4] == b"\x89PNG"
    assert "<svg" in (out / "calibration.svg").read_text()
    (first, *_) = csv.DictReader((out / "calibration.csv").read_text().splitlines())
    assert [first[k] for k in ("quantity", "n", "goal")] == ["initial speed", "1", "missed"]
    assert "Calibration of traffic: scenarios (test split)" in (out / "calibration.tex").read_text()


def test_tables_without_traffic_are_one_line(traffic: Path, run: Run) -> None:
    write_certificates([certificate(read_table(traffic / "test.parquet")[0])], certificates_path(traffic))
    assert "no density to compare" in run("calibration", expect=2)
