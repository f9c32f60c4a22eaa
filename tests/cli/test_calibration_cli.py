"""`tsbench scenarios calibration` on two scenes made by hand."""

from __future__ import annotations

import csv
import importlib
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tsbench.cli import main
from tsbench.core import paths as repository_paths
from tsbench.make.maps.netconvert import build_net
from tsbench.make.scenes.traffic import Car
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import read_network
from tsbench.scenarios.certificates import Certificate, certificates_path, write_certificates
from tsbench.scenarios.data_set import write_table
from tsbench.sim.scene import EgoStart

ROOT = Path(__file__).resolve().parents[2]
world = importlib.import_module("simworld")


def certificate(scenario_id: str, asked: float) -> Certificate:
    return Certificate(
        scenario_id=scenario_id, scenario_type="yield", split="test", attempt=0, expert="idm-e", expert_time_s=9.0,
        blind_baseline="idm", blind_outcome="arrived", tempting=True, engaged=True, asked_density=asked,
        realised_density=asked, road_users=3, overlaps=0, arrival_gap_s=0.0, error="", digest="", basis="", scoring=1,
        reproduced=None,
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A nominal row, and one with traffic."""
    root = tmp_path / "data" / "scenarios"
    root.mkdir(parents=True)
    (tmp_path / "data" / "sign_catalog").symlink_to(ROOT / "sign_catalog")
    shutil.copy(ROOT / "scenarios" / "nuplan_statistics.json", root)
    build_net(world.road_plain(), root / "road.net.xml.gz")
    maker = world.SceneMaker(root, root / "road.net.xml.gz", read_network(root / "road.net.xml.gz"))
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
    write_certificates([certificate("row0", 0.0), certificate("row1", 13.3)], certificates_path(root))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TSBENCH_DATA", str(tmp_path / "data"))
        patch.setenv("COLUMNS", "200")
        # The one simulation of this process is lent to the command.
        patch.setattr("tsbench.sim.sumo.Simulation", lambda: world.simulation())
        patch.setattr(world.simulation(), "close", lambda: None)
        repository_paths.data_root.cache_clear()
        yield root
    repository_paths.data_root.cache_clear()


def run(*arguments: str, expect: int) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["scenarios", "calibration", *arguments])
    assert ended.value.code == expect


def test_prints_distances_and_draws(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    run("--split", "test", "--out", str(out), expect=0)
    told = capsys.readouterr().out
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


def test_tables_without_traffic_are_one_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_certificates([certificate("row0", 0.0)], certificates_path(folder))
    run(expect=2)
    told = capsys.readouterr().err.strip()
    assert "no density to compare" in told
    assert "\n" not in told
