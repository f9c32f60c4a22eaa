"""`tsbench city`, `--city`, `seal` and `maps convert` of a city: a town from its extract to a table of drivers."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import stat
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from command_line import in_process
from data_folder import in_force
from odd_extracts import BUILT, grid, motorway
from town import EAST, Town, make_town

import tsbench
from tsbench.cli import main
from tsbench.core.paths import CITY
from tsbench.learn.envs.drive_env import DriveEnv
from tsbench.make.maps.utm import UtmFrame
from tsbench.make.seeds import SECRET, rng_of, root_sequence, seed_of, using_secret
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.run.edition import contract_now, edition_now, edition_of, editions
from tsbench.scenarios.data_set import DataSet

REPOSITORY = Path(__file__).resolve().parents[2]
NORTH = 5_540_000.0
FEW = ("--types", "yield", "--workers", "1")
Call = Callable[..., str]


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """What a clone has besides code and tables, with a made-up town as a city that is not built yet.

    The town is the city `nowhere` of zone 32; all of it is dev.
    """
    root = tmp_path_factory.mktemp("clone")
    shutil.copytree(REPOSITORY / "sumo_nets" / "netconvert", root / "sumo_nets" / "netconvert")
    shutil.copytree(REPOSITORY / "scenarios" / "recipes", root / "scenarios" / "recipes")
    shutil.copy(REPOSITORY / "scenarios" / "nuplan_statistics.json", root / "scenarios")
    shutil.copytree(REPOSITORY / "sign_catalog", root / "sign_catalog")
    shutil.copytree(REPOSITORY / "cities", root / "cities", ignore=shutil.ignore_patterns("data"))
    extract = root / "osm" / "nowhere.osm"
    extract.parent.mkdir()
    extract.write_text(make_town().xml(UtmFrame(32), NORTH), encoding="utf-8")
    digest = hashlib.sha256(extract.read_bytes()).hexdigest()
    city = yaml.safe_load((root / "cities" / "north-bayreuth.yaml").read_text())
    city |= {"city": "nowhere", "split": {"tile_m": 2000, "test_share": 0.0}, "maps": {"dev": 1}}
    city["extracts"] = [
        city["extracts"][0] | {"name": "nowhere", "code": "now", "sha256": digest, "bytes": extract.stat().st_size}
    ]
    (root / "cities" / "nowhere.yaml").write_text(yaml.safe_dump(city))
    (root / "cities" / "elsewhere.yaml").write_text(yaml.safe_dump(city | {"city": "elsewhere", "zone": 33}))
    with in_force(root) as patch:
        patch.delenv(CITY, raising=False)
        patch.setenv("COLUMNS", "200")
        yield root


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str]) -> Call:
    """Runs a command of tsbench: what it prints, and its errors. code: that it ends with."""

    def call(*arguments: str, code: int = 0) -> str:
        out, err = in_process(arguments[0], capsys)(*arguments[1:], expect=code)
        assert DataSet().name == "moscow", "a command leaves its city behind"
        if code:
            assert err.strip().count("\n") == 0, err
        return out + err

    return call


def rows_of(data: Path) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = pq.read_table(data / "scenarios" / "dev.parquet").to_pylist()
    return rows


@pytest.mark.slow
def test_from_an_extract_to_a_table(clone: Path, tmp_path: Path, call: Call) -> None:
    osm = ("--osm", str(clone / "osm"), "--types", "yield", "--types", "roundabout", "--workers", "1")
    built = call("city", "build", "nowhere", *osm)
    assert "1 of 1" in built
    assert "yield" in built, "an option that is given twice adds to what stood before"
    assert "tsbench run --city nowhere --split dev" in built, "what has no test split is not asked for it"
    data = clone / "cities" / "data" / "nowhere"
    rows = rows_of(data)
    assert {(r["split"], r["half"]) for r in rows} == {("dev", "signed"), ("dev", "contrast")}
    assert all(r["map_id"].split("-")[1] == "now" for r in rows)
    # Interrupted or not: the same again, to the byte.
    files = {path: path.read_bytes() for path in data.rglob("*.parquet") if "build" not in path.parts}
    call("city", "build", "nowhere", *osm)
    assert {path: path.read_bytes() for path in files} == files
    assert "0 problems" in call("scenarios", "verify", "--city", "nowhere")
    assert f"dev {len(rows)}" in call("city", "list")
    shown = call("city", "show", "nowhere", "--png", str(tmp_path / "map.png"))
    assert "yield" in shown
    assert (tmp_path / "map.png").stat().st_size > 10_000
    where = ("--osm", str(clone / "osm"), "--rose", str(tmp_path / "rose.png"))
    assert "orientation entropy" in call("city", "show", "nowhere", "--streets", *where)
    assert (tmp_path / "rose.png").stat().st_size > 10_000
    drivers = ("--planner", "idm", "--planner", "blind", "--planner", "idm-e", "--workers", "1")
    table = call("run", "--city", "nowhere", "--split", "dev", *drivers, "--out", str(tmp_path / "run"))
    name = f"nowhere-{editions()[-1].name}"
    assert f"edition {name}, contract" in table
    # A run knows whose scenes it drove.
    assert "disagreements: 0" in call("rescore", str(tmp_path / "run"))
    called = ("report", str(tmp_path / "run"), "--out", str(tmp_path / "report.html"))
    assert "cannot be played" not in call(*called)
    assert "nowhere, dev split" in (tmp_path / "report.html").read_text(encoding="utf-8")
    # From Python: a city is named where its scenes are asked for, and a run's is remembered.
    scenarios = tsbench.load_scenarios("dev", city="nowhere")
    assert scenarios[0].network.lanes, "read after the call, when another city is in use"
    traced = tsbench.evaluate(
        "idm", split="dev", city="nowhere", limit=1, workers=1, trace="all", out=tmp_path / "traced"
    )
    shown_episode = traced.show(traced.episodes["scenario_id"][0])
    assert shown_episode.frame.startswith(b"\x89PNG")
    town = DataSet.named("nowhere")
    assert edition_now(town) == name
    assert edition_of(contract_now(town, "dev"), "", town) == name
    assert edition_of("f" * 64, "", town) == f"{name}+local"


def described(clone: Path, name: str, content: bytes, **more: str) -> None:
    """The city of one extract, as `nowhere` is."""
    (clone / "osm" / f"{name}.osm").write_bytes(content)
    city = yaml.safe_load((clone / "cities" / "nowhere.yaml").read_text())
    digest = hashlib.sha256(content).hexdigest()
    city["extracts"][0] |= {"name": name, "code": name[:3], "sha256": digest, "bytes": len(content)}
    (clone / "cities" / f"{name}.yaml").write_text(yaml.safe_dump(city | {"city": name} | more))


@pytest.mark.slow
def test_a_town_with_traffic_on_the_left(
    clone: Path, tmp_path: Path, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The image of `nowhere`, in Britain: its scenes are those of `nowhere` in a mirror."""
    described(clone, "leftown", make_town().xml(UtmFrame(32, mirrored=True), NORTH).encode(), country="gb", side="left")
    osm = ("--osm", str(clone / "osm"), "--types", "yield", "--types", "roundabout", "--workers", "1")
    call("city", "build", "nowhere", *osm)
    built = call("city", "build", "leftown", *osm)
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
    shown = call("city", "show", "leftown", "--png", str(tmp_path / "map.png"))
    assert "traffic on the left" in shown
    drivers = ("--planner", "idm", "--planner", "idm-e", "--workers", "1", "--trace", "all")
    tables = [
        call("run", "--city", name, "--split", "dev", *drivers, "--out", str(tmp_path / name))
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
    assert tsbench.load_scenarios("dev")[0].network.left_hand
    assert DriveEnv(split="dev")._data.name == "mirrored-leftown"
    assert "edition mirrored-leftown" in call(
        "run", "--split", "dev", "--limit", "1", *drivers, "--out", str(tmp_path / "told")
    )


def test_a_city_without_any_scene_says_why_in_one_line(clone: Path, call: Call) -> None:
    described(clone, "motorway", motorway())
    osm = ("--osm", str(clone / "osm"), *FEW)
    told = call("city", "build", "motorway", *osm, code=2)
    assert "motorway: its 2 maps carry no scenario: no junction of T, X in its tiles (tsbench city show" in told
    assert not (clone / "cities" / "data" / "motorway" / "edition.yaml").exists()


def test_an_extract_in_the_next_zone_says_which_to_write(clone: Path, call: Call) -> None:
    described(clone, "beyond", make_town().xml(UtmFrame(33), NORTH).encode())
    told = call("city", "build", "beyond", "--osm", str(clone / "osm"), "--workers", "1", code=2)
    assert "beyond is in UTM zone 33, beyond in UTM zone 32" in told
    assert "write `zone: 33` into cities/beyond.yaml" in told


def test_a_city_is_shown_with_the_figures_of_its_country(clone: Path, call: Call) -> None:
    krems = call("city", "show", "krems")
    assert "country at, Austria: traffic on the right; junctions without signs: right before left" in krems
    assert "speeds in km/h: living_street 5, residential 50" in krems
    bayreuth = call("city", "show", "north-bayreuth")
    assert "country de, Germany" in bayreuth
    assert "plates: 32 of 34 with its number" in bayreuth
    assert "country ru: no figures" in call("city", "show", "moscow")


def test_a_side_that_is_not_its_country_s_is_refused(clone: Path, call: Call) -> None:
    path = clone / "cities" / "leeds.yaml"
    city = yaml.safe_load((clone / "cities" / "krems.yaml").read_text()) | {"city": "leeds", "country": "gb"}
    try:
        path.write_text(yaml.safe_dump(city | {"side": "right"}))
        told = call("city", "build", "leeds", "--osm", str(clone / "osm"), code=2)
        assert "side: right: traffic keeps to the left in 'gb'" in told
    finally:
        path.unlink()


def test_what_is_not_built_says_which_command_builds_it(clone: Path, call: Call) -> None:
    assert "nothing is built yet: tsbench city build krems --osm DIR" in call("city", "show", "krems")
    told = call("scenarios", "list", "--city", "krems", "--split", "dev", code=2)
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
def test_what_cannot_be_is_one_line(clone: Path, call: Call, arguments: tuple[str, ...], says: str) -> None:
    assert says in call(*arguments, code=2)


def test_an_extract_of_another_zone_is_no_part_of_a_city(clone: Path, tmp_path: Path, call: Call) -> None:
    shutil.copy(clone / "osm" / "nowhere.osm", tmp_path)
    told = call("city", "build", "elsewhere", "--osm", str(tmp_path), "--workers", "1", code=2)
    assert "nowhere is in UTM zone 32, elsewhere in UTM zone 33: one pool is of one city" in told
    told = call("maps", "harvest", "--osm", str(tmp_path), "--workers", "1", code=2)
    assert "nowhere is in UTM zone 32, moscow in UTM zone 37" in told


# Five hundred junctions are read in a test of their own; to cut and build as many takes minutes.
SMALLER = {"grid.osm": lambda: grid(4, 3)}


@pytest.mark.slow
@pytest.mark.parametrize("file", sorted(BUILT))
def test_an_odd_extract_ends_in_a_data_set_or_in_a_line(
    file: str, clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name, content = file.partition(".")[0], {**BUILT, **SMALLER}[file]()
    described(clone, name, content)
    with pytest.raises(SystemExit) as ended:
        main(["city", "build", name, "--osm", str(clone / "osm"), *FEW])
    told = capsys.readouterr()
    data = clone / "cities" / "data" / name
    if ended.value.code:
        assert (ended.value.code, told.err.strip().count("\n")) == (2, 0), told.err
        assert told.err.startswith("error: ")
        assert not (data / "edition.yaml").exists()
    else:
        rows = rows_of(data)
        assert {(row["split"], row["half"]) for row in rows} == {("dev", "signed"), ("dev", "contrast")}
        assert (data / "edition.yaml").exists()


def crossing(side: str) -> str:
    """Two roads that cross, and a ring that is driven as where traffic keeps to this side."""
    town = Town()
    town.road([(0, 0), (150, 0), (300, 0)], "residential")
    town.road([(150, -150), (150, 0), (150, 150)], "residential", lanes="2")
    angles = (-1.0 if side == "left" else 1.0) * np.radians(np.arange(0, 360, 15))
    ring = [(600 + 20 * float(np.cos(a)), 20 * float(np.sin(a))) for a in angles]
    town.road([*ring, ring[0]], "tertiary", junction="roundabout", oneway="yes")
    for x, y in ring[::6]:
        town.road([(x, y), (600 + 8 * (x - 600), 8 * y)], "tertiary")
    return town.xml(UtmFrame(32), NORTH)


@pytest.fixture(scope="module")
def crossings(clone: Path) -> Path:
    city = yaml.safe_load((clone / "cities" / "nowhere.yaml").read_text())
    city |= {"city": "lefthand", "country": "gb", "side": "left", "types": "town.typ.xml"}
    (clone / "cities" / "lefthand.yaml").write_text(yaml.safe_dump(city))
    for side in ("left", "right"):
        (clone / f"{side}.osm").write_text(crossing(side), encoding="utf-8")
    return clone


def converted(crossings: Path, call: Call, side: str, city: str) -> RoadNetwork:
    out = crossings / f"{side}.net.xml"
    said = call("maps", "convert", "--city", city, str(crossings / f"{side}.osm"), "--out", str(out))
    assert f"; traffic on the {side}" in said
    assert "lies in UTM zone" not in said
    return read_network(out)


@pytest.mark.parametrize(("side", "city", "sign"), [("left", "lefthand", 1.0), ("right", "nowhere", -1.0)])
def test_roads_are_where_they_are_and_traffic_on_its_side(
    side: str, city: str, sign: float, crossings: Path, call: Call
) -> None:
    network = converted(crossings, call, side, city)
    # Eastwards on the road at this northing, the lane is north of the middle or south of it.
    aside = {lane.edge: float(np.median(lane.line.points[:, 1])) - NORTH for lane in network.lanes}
    assert sign * aside["501#0"] == pytest.approx(1.6, abs=0.5)
    assert sign * aside["-501#0"] == pytest.approx(-1.6, abs=0.5)
    text = (crossings / f"{side}.net.xml").read_text()
    assert ('lefthand="true"' in text) is (side == "left")
    west, _, east, _ = map(float, re.findall(r'convBoundary="([^"]*)"', text)[0].split(","))
    assert (west, east) == pytest.approx((EAST, EAST + 760.0), abs=1.0)
    assert text.count("<roundabout ") == 1


def test_an_extract_of_elsewhere_is_said_to_be_one(crossings: Path, call: Call) -> None:
    files = (str(crossings / "left.osm"), "--out", str(crossings / "x.net.xml"))
    said = call("maps", "convert", "--city", "elsewhere", *files)
    assert "lies in UTM zone 32, elsewhere in 33, and has the side and limits of elsewhere" in said


@pytest.mark.slow
def test_sealed_scenes_are_committed_to_run_and_checked(clone: Path, tmp_path: Path, call: Call) -> None:
    data, keys = clone / "cities" / "data" / "nowhere", [tmp_path / name for name in ("mine", "another")]
    shutil.rmtree(data, ignore_errors=True)
    for key in keys:
        call("seal", "secret", str(key))
        assert stat.S_IMODE(key.stat().st_mode) == 0o600
    assert "File exists" in call("seal", "secret", str(keys[0]), code=2)

    def built(key: Path, code: int = 0) -> str:
        return call("seal", "build", "nowhere", "--secret", str(key), "--osm", str(clone / "osm"), *FEW, code=code)

    assert "tsbench seal commit nowhere" in built(keys[0])
    mine = rows_of(data)
    assert "begun with another secret" in built(keys[1], code=2)
    assert "0 problems" in call("scenarios", "verify", "--city", "nowhere")
    asked = ("--planner", "idm", "--limit", "2", "--workers", "1", "--out", str(tmp_path / "run"))
    assert "nowhere-" in call("run", "--city", "nowhere", "--split", "dev", *asked)

    published = tmp_path / "commitments.json"
    call("seal", "commit", "nowhere", "--out", str(published))
    told = published.read_text(encoding="utf-8")
    assert keys[0].read_text(encoding="utf-8").strip() not in told
    assert json.loads(told)["rows"]["dev"]["yield"] == len(mine)
    # What is published leads to no scene: no id, no seed, no map.
    assert not any(str(row[key]) in told for row in mine for key in ("scenario_id", "map_id", "seed"))
    check = ("seal", "check", str(published), "--secret")
    assert "and the secret" in call(*check, str(keys[0]))
    assert "is not the secret that was committed to" in call(*check, str(keys[1]), code=1)

    store = data / "scenarios" / "scenes" / "dev" / "yield.parquet"
    kept = store.read_bytes()
    store.write_bytes(kept[:-1] + b"x")
    (data / "scenarios" / "more.parquet").write_bytes(kept)
    found = call(*check, str(keys[0]), code=1)
    assert "scenarios/scenes/dev/yield.parquet: has SHA-256" in found
    assert "scenarios/more.parquet: is here and was not committed to" in found
    store.unlink()
    assert "yield.parquet: was committed to and is not here" in call(*check, str(keys[0]), code=1)

    # Whoever has the secret makes the same files again; without it, or with another, come other scenes.
    shutil.rmtree(data)
    built(keys[0])
    assert "all " in call(*check, str(keys[0]))
    for key in (keys[1], None):
        shutil.rmtree(data)
        if key is None:
            call("city", "build", "nowhere", "--osm", str(clone / "osm"), *FEW)
            assert "was built without a secret" in built(keys[0], code=2)
            assert "is not sealed" in call("seal", "commit", "nowhere", "--out", str(published), code=2)
        else:
            built(key)
        other = rows_of(data)
        assert {row["seed"] for row in other}.isdisjoint(row["seed"] for row in mine)


@pytest.mark.slow
def test_draws_are_the_public_ones_but_with_a_secret(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from tsbench.core import seeds

    monkeypatch.delenv(SECRET, raising=False)
    assert seed_of("a", 1) == seeds.seed_of("a", 1)
    assert rng_of("a").random() == seeds.rng_of("a").random()
    assert root_sequence(7).entropy == [seeds.ROOT_SEED, 7]
    key = tmp_path / "key"
    key.write_text("0" * 63 + "1\n", encoding="utf-8")
    with using_secret(key):
        assert seed_of("a", 1) != seeds.seed_of("a", 1)
        assert root_sequence(7).entropy == [seeds.ROOT_SEED, 7, 1]
    assert seed_of("a", 1) == seeds.seed_of("a", 1)


@pytest.mark.slow
def test_what_is_no_secret_or_no_commitment_is_one_line(tmp_path: Path, call: Call) -> None:
    wrong = tmp_path / "file"
    wrong.write_text("{}", encoding="utf-8")
    asked = ("seal", "build", "krems", "--secret", str(wrong))
    assert "is no secret" in call(*asked, code=2)
    assert f"{wrong}: schema: is missing" in call("seal", "check", str(wrong), code=2)
