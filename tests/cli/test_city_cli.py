"""`tsbench city` and `--city` from the outside: a town from its extract to a table of drivers."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from odd_extracts import motorway
from town import make_town
from town_clone import call, town_clone

import tsbench
from tsbench.core.errors import InputError
from tsbench.core.paths import using_city
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.make.maps.utm import UtmFrame
from tsbench.run.edition import contract_now, edition_now, edition_of, editions
from tsbench.scenarios.data_set import DataSet

REPOSITORY = Path(__file__).resolve().parents[2]
NORTH = 5_540_000.0


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with town_clone(tmp_path_factory.mktemp("clone")) as root:
        yield root


@pytest.mark.slow
def test_from_an_extract_to_a_table(clone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    osm = ("--osm", str(clone / "osm"), "--types", "yield", "--types", "roundabout", "--workers", "1")
    built = call(capsys, "city", "build", "nowhere", *osm)
    assert "1 of 1" in built
    assert "yield" in built, "an option that is given twice adds to what stood before"
    assert "tsbench run --city nowhere --split dev" in built, "what has no test split is not asked for it"
    data = clone / "cities" / "data" / "nowhere"
    rows = pq.read_table(data / "scenarios" / "dev.parquet").to_pylist()
    assert {(r["split"], r["half"]) for r in rows} == {("dev", "signed"), ("dev", "contrast")}
    assert all(r["map_id"].split("-")[1] == "now" for r in rows)
    # Interrupted or not: the same again, to the byte.
    files = {path: path.read_bytes() for path in data.rglob("*.parquet") if "build" not in path.parts}
    call(capsys, "city", "build", "nowhere", *osm)
    assert {path: path.read_bytes() for path in files} == files
    assert "0 problems" in call(capsys, "scenarios", "verify", "--city", "nowhere")
    assert f"dev {len(rows)}" in call(capsys, "city", "list")
    shown = call(capsys, "city", "show", "nowhere", "--png", str(tmp_path / "map.png"))
    assert "yield" in shown
    assert (tmp_path / "map.png").stat().st_size > 10_000
    where = ("--osm", str(clone / "osm"), "--rose", str(tmp_path / "rose.png"))
    assert "orientation entropy" in call(capsys, "city", "show", "nowhere", "--streets", *where)
    assert (tmp_path / "rose.png").stat().st_size > 10_000
    drivers = ("--planner", "idm", "--planner", "blind", "--planner", "idm-e", "--workers", "1")
    table = call(capsys, "run", "--city", "nowhere", "--split", "dev", *drivers, "--out", str(tmp_path / "run"))
    name = f"nowhere-{editions()[-1].name}"
    assert f"edition {name}, contract" in table
    # A run knows whose scenes it drove.
    assert "disagreements: 0" in call(capsys, "rescore", str(tmp_path / "run"))
    called = ("report", str(tmp_path / "run"), "--out", str(tmp_path / "report.html"))
    assert "cannot be played" not in call(capsys, *called)
    assert "nowhere, dev split" in (tmp_path / "report.html").read_text(encoding="utf-8")
    # From Python: a city is named where its scenes are asked for, and a run's is remembered.
    scenarios = tsbench.load_scenarios("dev", city="nowhere")
    assert scenarios[0].network.lanes, "read after the call, when another city is in use"
    traced = tsbench.evaluate(
        "idm", split="dev", city="nowhere", limit=1, workers=1, trace="all", out=tmp_path / "traced"
    )
    shown_episode = traced.show(traced.episodes["scenario_id"][0])
    assert shown_episode.frame.startswith(b"\x89PNG")
    with using_city("nowhere"):
        assert edition_now(DataSet.in_use()) == name
        assert edition_of(contract_now(DataSet.in_use(), "dev"), "", DataSet.in_use()) == name
        assert edition_of("f" * 64, "", DataSet.in_use()) == f"{name}+local"


def described(clone: Path, name: str, content: bytes, **more: str) -> None:
    """The city of one extract, as `nowhere` is."""
    (clone / "osm" / f"{name}.osm").write_bytes(content)
    city = yaml.safe_load((clone / "cities" / "nowhere.yaml").read_text())
    digest = hashlib.sha256(content).hexdigest()
    city["extracts"][0] |= {"name": name, "code": name[:3], "sha256": digest, "bytes": len(content)}
    (clone / "cities" / f"{name}.yaml").write_text(yaml.safe_dump(city | {"city": name} | more))


@pytest.mark.slow
def test_a_town_with_traffic_on_the_left(
    clone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The image of `nowhere`, in Britain: its scenes are those of `nowhere` in a mirror."""
    described(clone, "leftown", make_town().xml(UtmFrame(32, mirrored=True), NORTH).encode(), country="gb", side="left")
    osm = ("--osm", str(clone / "osm"), "--types", "yield", "--types", "roundabout", "--workers", "1")
    call(capsys, "city", "build", "nowhere", *osm)
    built = call(capsys, "city", "build", "leftown", *osm)
    assert "tsbench run --city leftown --split dev" in built
    theirs, ours = (
        pq.read_table(clone / "cities" / "data" / name / "scenarios" / "dev.parquet").to_pylist()
        for name in ("nowhere", "leftown")
    )
    assert [r["scenario_type"] for r in ours] == [r["scenario_type"] for r in theirs]
    # Degrees are those of the true town, whose image `nowhere` is: about the meridian of zone 32.
    data = clone / "cities" / "data"
    pools = [pq.read_table(data / name / "sumo_nets" / "pool.parquet") for name in ("nowhere", "leftown")]
    one, other = ({key: np.sort(pool[key].to_numpy()) for key in ("lat", "lon")} for pool in pools)
    assert np.allclose(one["lat"], other["lat"], rtol=0.0, atol=3e-6)
    assert np.allclose(18.0 - one["lon"][::-1], other["lon"], rtol=0.0, atol=3e-6)
    shown = call(capsys, "city", "show", "leftown", "--png", str(tmp_path / "map.png"))
    assert "traffic on the left" in shown
    drivers = ("--planner", "idm", "--planner", "idm-e", "--workers", "1", "--trace", "all")
    tables = [
        call(capsys, "run", "--city", name, "--split", "dev", *drivers, "--out", str(tmp_path / name))
        for name in ("leftown", "mirrored-nowhere")
    ]
    assert f"edition mirrored-leftown-{editions()[-1].name}" in tables[0]
    columns = ["planner", "half", "outcome", "scd"]
    ended = [
        pq.read_table(tmp_path / name / "episodes.parquet", columns=columns).to_pylist()
        for name in ("leftown", "mirrored-nowhere")
    ]
    assert ended[0] == ended[1]
    scenarios = tsbench.load_scenarios("dev", city="leftown")
    assert scenarios[0].network.left_hand
    monkeypatch.setenv("TSBENCH_CITY", "leftown")
    with pytest.raises(InputError, match="leftown: is stored in a mirror; name mirrored-leftown"):
        tsbench.evaluate("idm", split="dev", limit=1, workers=1, out=tmp_path / "wrong")
    with pytest.raises(InputError, match="leftown: is stored in a mirror"):
        DriveEnv(split="dev")
    with pytest.raises(InputError, match="leftown: is stored in a mirror"):
        tsbench.load_scenarios("dev")


def test_a_city_without_any_scene_says_why_in_one_line(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    described(clone, "motorway", motorway())
    osm = ("--osm", str(clone / "osm"), "--types", "yield", "--workers", "1")
    told = call(capsys, "city", "build", "motorway", *osm, code=2)
    assert "motorway: its 2 maps carry no scenario: no junction of T, X in its tiles (tsbench city show" in told
    assert not (clone / "cities" / "data" / "motorway" / "edition.yaml").exists()


def test_an_extract_in_the_next_zone_says_which_to_write(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    described(clone, "beyond", make_town().xml(UtmFrame(33), NORTH).encode())
    told = call(capsys, "city", "build", "beyond", "--osm", str(clone / "osm"), "--workers", "1", code=2)
    assert "beyond is in UTM zone 33, beyond in UTM zone 32" in told
    assert "write `zone: 33` into cities/beyond.yaml" in told


def test_a_city_is_shown_with_the_figures_of_its_country(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    krems = call(capsys, "city", "show", "krems")
    assert "country at, Austria: traffic on the right; junctions without signs: right before left" in krems
    assert "speeds in km/h: living_street 5, residential 50" in krems
    bayreuth = call(capsys, "city", "show", "north-bayreuth")
    assert "country de, Germany" in bayreuth
    assert "plates: 32 of 34 with its number" in bayreuth
    assert "country ru: no figures" in call(capsys, "city", "show", "moscow")


def test_a_side_that_is_not_its_country_s_is_refused(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = clone / "cities" / "leeds.yaml"
    city = yaml.safe_load((clone / "cities" / "krems.yaml").read_text()) | {"city": "leeds", "country": "gb"}
    try:
        path.write_text(yaml.safe_dump(city | {"side": "right"}))
        told = call(capsys, "city", "build", "leeds", "--osm", str(clone / "osm"), code=2)
        assert "side: right: traffic keeps to the left in 'gb'" in told
    finally:
        path.unlink()


def test_what_is_not_built_says_which_command_builds_it(clone: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "nothing is built yet: tsbench city build krems --osm DIR" in call(capsys, "city", "show", "krems")
    told = call(capsys, "scenarios", "list", "--city", "krems", "--split", "dev", code=2)
    assert "cities/data/krems/scenarios/dev.parquet" in told
    assert "tsbench city build krems --osm DIR makes it" in told


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("scenarios", "list", "--city", "../x"), "a city's name is of a-z, 0-9 and '-'"),
        (("city", "show", "atlantis"), "no such city; there are andorra, "),
        (("city", "show", "mirrored-krems"), "no city of its own, but krems in a mirror"),
        (("city", "build", "mirrored-krems", "--osm", "."), "no city of its own, but krems in a mirror"),
        (("scenarios", "list", "--city", "mirrored-krems", "--split", "dev"), "tsbench city build krems --osm DIR"),
        (("city", "build", "moscow", "--osm", "."), "moscow is the benchmark's own: tsbench maps harvest"),
        (("city", "build", "krems", "--osm", "nowhere"), "no such folder of OSM extracts"),
    ],
)
def test_what_cannot_be_is_one_line(
    clone: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], says: str
) -> None:
    assert says in call(capsys, *arguments, code=2)


def test_an_extract_of_another_zone_is_no_part_of_a_city(
    clone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(clone / "osm" / "nowhere.osm", tmp_path)
    told = call(capsys, "city", "build", "elsewhere", "--osm", str(tmp_path), "--workers", "1", code=2)
    assert "nowhere is in UTM zone 32, elsewhere in UTM zone 33: one pool is of one city" in told
    told = call(capsys, "maps", "harvest", "--osm", str(tmp_path), "--workers", "1", code=2)
    assert "nowhere is in UTM zone 32, moscow in UTM zone 37" in told
