"""`tsbench city` and `--city` from the outside: a town from its extract to a table of drivers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import yaml
from town_clone import call, town_clone

import tsbench
from tsbench.core.paths import using_city
from tsbench.run.edition import contract_now, edition_now, edition_of, editions

REPOSITORY = Path(__file__).resolve().parents[2]
NORTH = 5_540_000.0


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with town_clone(tmp_path_factory.mktemp("clone")) as root:
        yield root


@pytest.mark.slow
@pytest.mark.own_process
def test_from_an_extract_to_a_table(clone: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    osm = ("--osm", str(clone / "osm"), "--types", "yield,roundabout", "--workers", "1")
    built = call(capsys, "city", "build", "nowhere", *osm)
    assert "1 of 1" in built
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
    drivers = ("--planner", "idm", "--planner", "blind", "--planner", "idm-e", "--workers", "1")
    table = call(
        capsys, "run", "--city", "nowhere", "--split", "dev", *drivers, "--out", str(tmp_path / "run")
    )
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
        assert edition_now() == name
        assert edition_of(contract_now("dev")) == name
        assert edition_of("f" * 64) == f"{name}+local"


def test_a_city_is_shown_with_the_figures_of_its_country(
    clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    krems = call(capsys, "city", "show", "krems")
    assert "country at, Austria: traffic on the right; junctions without signs: right before left" in krems
    assert "speeds in km/h: living_street 5, residential 50" in krems
    bayreuth = call(capsys, "city", "show", "north-bayreuth")
    assert "country de, Germany" in bayreuth
    assert "plates: 32 of 34 with its number" in bayreuth
    assert "country ru: no figures" in call(capsys, "city", "show", "moscow")


def test_where_traffic_keeps_to_the_left_nothing_is_built(
    clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever the file says of its side: right-hand roads are no city of the United Kingdom."""
    path = clone / "cities" / "leeds.yaml"
    city = yaml.safe_load((clone / "cities" / "krems.yaml").read_text()) | {"city": "leeds", "country": "gb"}
    try:
        for side, says in (("right", "country: traffic keeps to the left in 'gb'"), ("left", "side: 'left'")):
            path.write_text(yaml.safe_dump(city | {"side": side}))
            assert says in call(capsys, "city", "build", "leeds", "--osm", str(clone / "osm"), code=2)
    finally:
        path.unlink()


def test_what_is_not_built_says_which_command_builds_it(
    clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "nothing is built yet: tsbench city build krems --osm DIR" in call(capsys, "city", "show", "krems")
    told = call(capsys, "scenarios", "list", "--city", "krems", "--split", "dev", code=2)
    assert "cities/data/krems/scenarios/dev.parquet" in told
    assert "tsbench city build krems --osm DIR makes it" in told


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("scenarios", "list", "--city", "../x"), "a city's name is of a-z, 0-9 and '-'"),
        (("city", "show", "atlantis"), "no such city; there are andorra, "),
        (
            ("city", "new", "leeds", "--bbox", "-1.6,53.7,-1.5,53.8", "--country", "gb", "--osm", "."),
            "--country gb: traffic keeps to the left there",
        ),
        (("city", "show", "mirrored-krems"), "no city of its own, but krems in a mirror"),
        (("city", "build", "mirrored-krems", "--osm", "."), "no city of its own, but krems in a mirror"),
        (
            ("scenarios", "list", "--city", "mirrored-krems", "--split", "dev"),
            "tsbench city build krems --osm DIR",
        ),
        (("city", "build", "moscow", "--osm", "."), "moscow is the benchmark's own: tsbench maps harvest"),
        (("city", "build", "krems", "--osm", "nowhere"), "no such folder of OSM extracts"),
    ],
)
def test_what_cannot_be_is_one_line(
    clone: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], says: str
) -> None:
    assert says in call(capsys, *arguments, code=2)


def test_an_extract_of_another_zone_is_no_part_of_a_city(
    clone: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = call(capsys, "city", "build", "elsewhere", "--osm", str(clone / "osm"), "--workers", "1", code=2)
    assert "nowhere is in UTM zone 32, elsewhere in UTM zone 33: one pool is of one city" in told
    told = call(capsys, "maps", "harvest", "--osm", str(clone / "osm"), "--workers", "1", code=2)
    assert "nowhere is in UTM zone 32, moscow in UTM zone 37" in told
