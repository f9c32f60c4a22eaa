"""Perception levels: rates, geometry, luck that both halves share, and the same bytes in any process and order."""

from __future__ import annotations

import hashlib
import json
import math
import subprocess
import sys
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from tsbench.core.errors import InputError
from tsbench.core.typed import typed
from tsbench.episode.perception import (
    FALSE,
    MISREAD,
    OUTLINE,
    POST,
    RIGHT,
    Plate,
    SignDetection,
    SignDetector,
    faces,
    in_field,
)
from tsbench.episode.perception_level import Perception, PerceptionLevel, load_level
from tsbench.episode.runner import EpisodeRunner
from tsbench.episode.trace import read_trace, write_trace
from tsbench.planners.observation import SignView
from tsbench.planners.registry import resolve
from tsbench.roads.road_map import RoadMap
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import DT_S, ActorKind, Actors, ActorTable, EgoState, WorldSnapshot

LEVELS = ("good", "production", "poor")
SPEED = 11.0


def level(name: str, **changes: object) -> PerceptionLevel:
    found = load_level(name)
    assert found is not None
    return replace(found, **changes)  # type: ignore[arg-type]


def ego(x: float) -> EgoState:
    return EgoState(x, 0.0, 0.0, SPEED, 0.0, 0.0, 0.0, -1, 0.0, 0.0, True)


def plate(
    x: float = 100.0, y: float = -4.0, heading: float = 0.0, code: str = "3.18.1", value: float | None = None
) -> Plate:
    return Plate("sign_0", "target", SignView(code, value, x, y, heading, "", -1, math.nan, math.inf))


def nobody() -> Actors:
    real = np.zeros(0)
    return Actors(ActorTable(1), np.zeros(0, np.int32), np.zeros((0, 3)), real, np.zeros(0, np.int32), real)


def parked(kind: ActorKind, length: float) -> Actors:
    """One vehicle between the ego at 0 and the plate at 60."""
    table = ActorTable(1)
    table.add("one", kind, length, 2.5, ())
    pose = np.array([[30.0, -2.0, 0.0]])
    return Actors(table, np.zeros(1, np.int32), pose, np.zeros(1), np.zeros(1, np.int32), np.zeros(1))


@cache
def a_map() -> RoadMap:
    row = DataSet().table("dev")[0]
    return SceneLoader(DataSet()).load(row)[1].view.map


def drive(
    of: PerceptionLevel, pair: str, *plates: Plate, metres: float = 95.0, others: Actors | None = None
) -> list[SignDetection]:
    """What is told on the way towards plates at a steady speed."""
    eyes, around = SignDetector(of, pair, plates, a_map(), load_catalog()), others or nobody()
    for step in range(int(metres / (SPEED * DT_S))):
        here = ego(step * SPEED * DT_S)
        eyes.look(WorldSnapshot(step, step * DT_S, here, around), here)
    return eyes.told


def agrees(k: int, n: int, share: float) -> bool:
    """Does the 99.9 % interval of k in n hold the share?"""
    low, high = binomtest(k, n).proportion_ci(confidence_level=0.999, method="wilson")
    return bool(low <= share <= high)


LOOKS = 4_000


def read_at_once(of: PerceptionLevel, seen: Plate) -> int:
    """How often of so many looks at a plate, one each, it is told."""
    return sum(len(drive(of, f"pair {k}", seen, metres=SPEED * DT_S)) for k in range(LOOKS))


@pytest.mark.parametrize("name", LEVELS)
def test_rates_over_a_thousand_plates(name: str) -> None:
    of, n = level(name), 1_000
    kinds, delays = [], []
    for k in range(n):
        told = {t.kind: t for t in drive(replace(of, false_per_km=0.0), f"pair {k}", plate(60.0), metres=50.0)}
        kinds.append(RIGHT if RIGHT in told else MISREAD if MISREAD in told else "")
        delays += [t.step for t in told.values() if t.kind != POST]
    assert agrees(kinds.count(RIGHT), n, of.right)
    assert agrees(kinds.count(MISREAD), n, (1.0 - of.right) * of.misread)
    assert min(delays) == round(of.latency_s / DT_S)


@pytest.mark.parametrize("name", LEVELS)
def test_one_look_at_a_large_plate_has_the_level_s_ceiling(name: str) -> None:
    of = level(name, latency_s=0.0, posts=False)
    assert agrees(read_at_once(of, plate(12.0, -1.0)), LOOKS, of.ceiling)


def test_half_of_what_is_ever_read_is_read_at_the_half_size() -> None:
    of = level("good", right=1.0, ceiling=1.0, latency_s=0.0, posts=False)
    assert agrees(read_at_once(of, plate(1266.0 * 0.7 / of.half_px, 0.0)), LOOKS, 0.5)


def test_false_plates_come_at_the_level_s_rate() -> None:
    of = level("poor", false_per_km=5.0)
    told = [t for k in range(20) for t in drive(of, f"pair {k}", metres=1000.0)]
    assert {t.kind for t in told} == {FALSE}
    # Poisson: 100 expected.
    assert abs(len(told) - 100) < 4 * math.sqrt(100)
    assert drive(level("good"), "pair", metres=2000.0) == []


def test_geometry() -> None:
    here = ego(0.0)
    assert in_field(here, plate(60.0).view)
    assert in_field(here, plate(100.0, 0.0).view)
    assert not in_field(here, plate(100.1, 0.0).view)
    for angle, seen in ((59.0, True), (61.0, False)):
        at = math.radians(angle)
        assert in_field(here, plate(20 * math.cos(at), 20 * math.sin(at), at).view) is seen
    for turned, seen in ((74.0, True), (76.0, False), (180.0, False)):
        assert faces(here, plate(30.0, 0.0, math.radians(turned)).view) is seen
    assert not faces(here, plate(100.1, 0.0).view)


@pytest.mark.parametrize(
    ("kind", "length", "hidden"),
    [
        (ActorKind.BUS, 12.0, True),
        (ActorKind.CAR, 8.0, True),
        (ActorKind.CAR, 4.5, False),
        (ActorKind.BICYCLE, 8.0, False),
    ],
)
def test_only_what_is_high_hides_a_plate(kind: ActorKind, length: float, hidden: bool) -> None:
    of = level("good", right=1.0, ceiling=1.0, false_per_km=0.0)
    told = drive(of, "pair", plate(60.0), metres=5.0, others=parked(kind, length))
    assert (told == []) is hidden
    # Past the vehicle it is there to see.
    assert drive(of, "pair", plate(60.0), metres=55.0, others=parked(kind, length))


def test_a_plate_from_behind_is_an_outline_and_never_misread() -> None:
    of, n = level("poor", false_per_km=0.0), 400
    stop = plate(60.0, heading=math.pi, code="2.5")
    stop = replace(stop, view=replace(stop.view, outline="octagon"))
    told = [drive(of, f"pair {k}", stop, metres=58.0) for k in range(n)]
    assert {(t.kind, t.code, t.outline) for one in told for t in one} == {(OUTLINE, "", "octagon")}
    assert {len(one) for one in told} == {0, 1}
    # As often as its face would be read; on its edge nothing is seen.
    assert agrees(sum(map(len, told)), n, of.right)
    assert drive(of, "pair", replace(stop, view=replace(stop.view, heading=math.pi / 2)), metres=30.0) == []


def test_a_face_tells_more_than_a_back_did() -> None:
    of = level("good", right=1.0, ceiling=1.0, false_per_km=0.0)
    stop = plate(30.0, 0.0, math.pi, "2.5")
    stop = replace(stop, view=replace(stop.view, outline="octagon"))
    eyes = SignDetector(of, "pair", [stop], a_map(), load_catalog())
    kinds = []
    for step in range(12):
        here = ego(0.0) if step < 6 else replace(ego(60.0), heading=math.pi)
        shown = eyes.look(WorldSnapshot(step, step * DT_S, here, nobody()), here)
        kinds += [(one.code, one.outline) for one in shown][:1]
    assert list(dict.fromkeys(kinds)) == [("", "octagon"), ("2.5", "octagon")]
    assert [t.kind for t in eyes.told] == [OUTLINE, RIGHT]


@pytest.mark.parametrize(
    ("code", "value", "as_what"),
    [
        ("3.24", 40.0, {("3.24", 20.0), ("3.24", 60.0)}), ("3.24", 60.0, {("3.24", 40.0)}), ("4.6", 50.0, set()),
        ("3.18.1", None, {("3.18.2", None)}), ("4.1.2", None, {("4.1.3", None)}), ("2.4", None, set()),
        ("5.21", 20.0, set()),
    ],
)  # fmt: skip
def test_misreadings_stay_in_the_family(code: str, value: float | None, as_what: set[tuple[str, float | None]]) -> None:
    of = level("poor", right=0.0, misread=1.0, false_per_km=0.0)
    told = [t for k in range(40) for t in drive(of, f"pair {k}", plate(60.0, code=code, value=value), metres=58.0)]
    assert {(t.code, t.value) for t in told if t.kind == MISREAD} == as_what


def test_both_halves_have_the_same_luck() -> None:
    for k in range(100):
        halves = [drive(level("poor"), f"pair {k}", plate(60.0, code=code)) for code in ("3.18.1", "4.1.2")]
        assert [(t.step, t.kind, t.x) for t in halves[0]] == [(t.step, t.kind, t.x) for t in halves[1]]


def test_what_was_read_is_told_as_long_as_it_is_in_range() -> None:
    of = level("good", right=1.0, ceiling=1.0, noise_m=0.0)
    eyes = SignDetector(of, "pair", [plate(40.0)], a_map(), load_catalog())
    for step in range(60):
        here = ego(step * SPEED * DT_S)
        known = eyes.look(WorldSnapshot(step, step * DT_S, here, nobody()), here)
    assert here.x > 60.0
    assert [(v.code, v.x) for v in known] == [("3.18.1", 40.0)]


def test_levels_of_files(tmp_path: Path) -> None:
    assert load_level("exact") is None
    path = tmp_path / "fog.yaml"
    path.write_text("{right: 0.5, ceiling: 0.5, misread: 0.1, false_per_km: 0, latency_s: 0.3, half_px: 25}")
    fog = load_level(str(path))
    assert (fog.name, fog.half_px, fog.scale_px) == ("fog", 25.0, level("good").scale_px)
    for text, words in (
        ("{right: 0.5}", "ceiling: is missing"),
        (path.read_text().replace("0.5,", "1.5,", 1), "right: must be a number <= 1.0, not 1.5"),
        ("[]", "a mapping"),
    ):
        path.write_text(text)
        with pytest.raises(InputError, match=words):
            load_level(str(path))
    with pytest.raises(InputError, match=r"expected exact, good, production, poor, or a \.yaml file"):
        load_level("bad")


def driven(scenarios: list[str], folder: Path) -> dict[str, str]:
    """Hashes of the traces of episodes with poor eyes, driven in this order."""
    rows = {row.scenario_id: row for row in DataSet().table("dev")}
    perception, hashes = Perception(level=level("poor", false_per_km=20.0)), {}
    runner = EpisodeRunner(resolve("idm"), perception=perception)
    for name in scenarios:
        path = folder / f"{name}.parquet"
        write_trace(path, runner.run(rows[name]))
        hashes[name] = hashlib.sha256(path.read_bytes()).hexdigest()
    runner.close()
    return hashes


def test_the_same_bytes_in_two_processes_and_in_any_order(tmp_path: Path) -> None:
    rows = DataSet().table("dev")
    pairs = {next(r.pair_id for r in rows if r.scenario_type == kind) for kind in ("speed_limit", "yield")}
    names = [r.scenario_id for r in rows if r.pair_id in pairs]
    here = driven(names, tmp_path)
    code = (
        "import json\nfrom pathlib import Path\nfrom tests.episode.test_perception import driven\n"
        f"print(json.dumps(driven({names[::-1]}, Path({str(tmp_path)!r}))))"
    )
    root = Path(__file__).resolve().parents[2]
    there = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True).stdout
    assert json.loads(there) == here
    told = read_trace(tmp_path / f"{names[0]}.parquet").told
    assert told
    assert told == tuple(typed(SignDetection, asdict(one)) for one in told)


def test_exact_tells_nothing_and_keeps_its_bytes(tmp_path: Path) -> None:
    row = next(r for r in DataSet().table("dev") if r.scenario_type == "yield")
    runner = EpisodeRunner(resolve("idm"))
    write_trace(tmp_path / "plain.parquet", runner.run(row))
    runner.close()
    assert read_trace(tmp_path / "plain.parquet").told == ()
    assert b'"told"' not in (tmp_path / "plain.parquet").read_bytes()
