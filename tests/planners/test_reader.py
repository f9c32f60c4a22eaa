"""`reader` and `careful` obey what they were told, as what they were told it; lawful styles drive in their manner."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from planner_loop import KMH, Body, World, constant, front_of, ids, load, target_plate, verdict
from pool_builders import built_site, recipe_of, two_way
from simworld import loader_of, simulation

from tsbench.episode.perception_level import EXACTLY, Perception, load_level
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.observation import Observation, SignView
from tsbench.planners.reader import Assertive, Cautious, Elderly, FirstSign, LegalStyle, Reader
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.roads.lane_graph import Destination
from tsbench.run.log.record import make_record
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.world import DT_S, EGO_LENGTH_M

READER, CAREFUL = (f"tsbench.planners.reader:{name}" for name in ("Reader", "Careful"))


def passed(planner: str, right: float | None, kind: str = "direction_right") -> list[bool]:
    """SCD of the signed and the contrast half of dev's last pair of a type. right: share read; None: exact eyes."""
    rows = [r for r in DataSet().table("dev") if r.pair_type == kind]
    halves = sorted((r for r in rows if r.pair_id == rows[-1].pair_id), key=lambda r: r.half, reverse=True)
    level = EXACTLY
    if right is not None:
        poor = load_level("poor")
        assert poor is not None
        level = Perception(level=replace(poor, right=right, misread=0.0, ceiling=1.0, false_per_km=0.0))
    runner = EpisodeRunner(resolve(planner), perception=level)
    found = [bool(make_record(runner.run(row), privileged=True).row["scd"]) for row in halves]
    runner.close()
    return found


def test_who_reads_passes_both_halves_and_who_does_not_never_both() -> None:
    for planner in (READER, CAREFUL):
        assert passed(planner, None) == [True, True]
        assert passed(planner, 1.0) == [True, True]
    assert passed(READER, 0.0) == [False, True]
    assert passed(CAREFUL, 0.0) != [True, True]


def test_the_backs_of_the_other_arms_plates_are_read() -> None:
    """At `secondary_road` the ego has no plate, and sees those of the road that it crosses from behind."""
    assert passed(READER, None, "secondary_road") == [True, True]
    assert passed(READER, 1.0, "secondary_road") == [True, True]
    assert passed(READER, 0.0, "secondary_road") == [False, True]


# The posts of stop_and_no_turn are three metres apart; in limit_in_zone one limit ends the other.
_ALONE = [("Reader", 4), ("FirstSign", 2), ("LastSign", 2)]
_SQUARES = [(*alone, kind) for kind in ("limit_and_yield", "stop_and_no_turn") for alone in _ALONE]


@pytest.mark.parametrize(("name", "rows_passed", "type_id"), [*_SQUARES, ("Reader", 4, "limit_in_zone")])
def test_one_sign_of_two_is_half_of_a_square(name: str, rows_passed: int, type_id: str) -> None:
    rows = [row for row in DataSet().table("two-signs") if row.pair_type == type_id][:4]
    assert len({row.pair_name for row in rows}) == 1
    runner = EpisodeRunner(resolve(f"tsbench.planners.reader:{name}"))
    found = [make_record(runner.run(row), privileged=True).row["scd"] for row in rows]
    runner.close()
    assert sum(found) == rows_passed


Told = tuple[str, float | None, bool]


class Monochrome(Reader):
    """Sees no ground: the later limit rules."""

    def _read(self, observation: Observation) -> dict[str, Told]:
        return {sign: (code, value, False) for sign, (code, value, _) in super()._read(observation).items()}


class Slowest(Monochrome):
    """The lowest of the limits that it has read rules."""

    def _read(self, observation: Observation) -> dict[str, Told]:
        found = self._told | super()._read(observation)
        lowest = min((value for _, value, _ in found.values() if value is not None), default=None)
        return {sign: (code, lowest, False) for sign, (code, _, _) in found.items()}


class OnlyTemporary(Reader):
    """Overlooks permanent plates."""

    def _read(self, observation: Observation) -> dict[str, Told]:
        return {sign: told for sign, told in super()._read(observation).items() if told[2]}


@pytest.fixture(scope="module")
def temporary_limit(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, tuple[ScenarioSpec, ...]]:
    """A square of it on a road made by hand."""
    root = tmp_path_factory.mktemp("square")
    # Both limits of this variant are below the road's.
    site = built_site(recipe_of("temporary_limit"), root, two_way(length=300.0), lambda variants: variants[1:2])
    assert not site.reason
    return root, site.rows


@pytest.mark.parametrize(
    ("driver", "passed_rows"),
    [
        (Reader, [True, True, True, True]),
        (Elderly, [True, True, True, True]),
        (Assertive, [True, True, True, True]),
        (Monochrome, [False, False, True, True]),
        (Slowest, [True, False, False, False]),
        (OnlyTemporary, [True, True, False, False]),
        (FirstSign, [True, True, False, False]),
    ],
)
def test_the_ground_of_a_limit_decides(
    temporary_limit: tuple[Path, tuple[ScenarioSpec, ...]], driver: type[Reader], passed_rows: list[bool]
) -> None:
    root, rows = temporary_limit
    runner = EpisodeRunner(
        LoadedPlanner("driver", driver, privileged=True), simulation=simulation(), loader=loader_of(root)
    )
    assert [make_record(runner.run(row), privileged=True).row["scd"] for row in rows] == passed_rows


STYLES = (Cautious, Elderly, Assertive)
TYPES = ("speed_limit", "min_speed", "yield", "stop", "crosswalk", "direction_right")
_LINE_M = 200.0


def _zone(planner: Reader, plate_kmh: float) -> World:
    """Along a road with a limit plate at `_LINE_M`."""
    network = load("long")
    plate = SignView("3.24", plate_kmh, 0.0, 0.0, 0.0, "ab", -1, _LINE_M, 10.0)
    return World(
        network, "ab_0", 20.0, 8.0, Destination("ab", 400.0), signs=(plate,),
        target=target_plate("3.24", "ab", plate_kmh, _LINE_M, zone_edges="ab"),
    ).run(planner, 120.0)  # fmt: skip


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("plate_kmh", [20.0, 40.0, 90.0])
def test_keeps_to_its_share_of_the_limit_that_binds(style: type[LegalStyle], plate_kmh: float) -> None:
    world = _zone(style(), plate_kmh)
    road_kmh = world.network.lane("ab_0").speed * KMH
    before = max(e.speed for e in world.states if front_of(e) < _LINE_M - 60.0) * KMH
    inside = max(e.speed for e in world.states if front_of(e) > _LINE_M + 100.0) * KMH
    assert world.arrived
    assert verdict(world).compliant
    assert before <= style.share * road_kmh + 0.5
    assert inside == pytest.approx(style.share * min(plate_kmh, road_kmh), abs=1.5)


def _cross(planner: Reader, arrives_s: float, speed: float = 8.0) -> World:
    """From the south over a main road, on which one vehicle comes."""
    network = load("cross")
    lane, main = network.lane("sc_0").line.length, network.lane("wc_0").line.length
    body = Body("other", tuple(ids(network, "wc", "ce")), main - speed * arrives_s, constant(speed), ("wc", "ce"))
    plate = SignView("2.4", None, 0.0, 0.0, 0.0, "sc", -1, lane - 3.0, 10.0)
    return World(
        network, "sc_0", lane - 40.0, 8.0, Destination("cn", 60.0), bodies=[body], signs=(plate,),
        target=target_plate("2.4", "sc", junction="c", approach="sc", main_in="wc ec"),
    ).run(planner, 60.0)  # fmt: skip


def _entered_s(world: World) -> float:
    length = world.network.lane("sc_0").line.length
    line = world.network.lane("sc_0").line
    gone = (line.project(e.x, e.y)[0] + EGO_LENGTH_M / 2 for e in world.states)
    return DT_S * next(k for k, s in enumerate(gone) if s >= length)


def test_only_the_elderly_driver_waits_for_a_wide_gap() -> None:
    # The others are at the line after 5 s, and six seconds remain.
    arrives = 11.0
    for style in (Reader, Cautious, Assertive):
        assert _entered_s(_cross(style(), arrives)) < arrives - 4.0
    late = _cross(Elderly(), arrives)
    assert _entered_s(late) > arrives
    assert late.arrived
    assert verdict(late).compliant


def test_the_elderly_driver_starts_late_and_gently() -> None:
    def after_standing(planner: Reader) -> list[float]:
        states = _cross(planner, 6.0, 5.0).states
        stood = max(k for k, e in enumerate(states) if e.speed < 0.05)
        return [e.speed for e in states[stood : stood + 30]]

    gentle = after_standing(Elderly())
    assert gentle[-1] <= 3.0 * Elderly.start_mps2 + 0.1
    assert after_standing(Reader())[-1] > 1.2 * gentle[-1]


@pytest.mark.parametrize("style", STYLES)
def test_passes_both_halves_of_nominal_pairs(style: type[LegalStyle]) -> None:
    nominal = [r for r in DataSet().table("dev") if r.pair_type in TYPES and not r.variant]
    rows = [r for kind in TYPES for r in [r for r in nominal if r.pair_type == kind][:2]]
    runner = EpisodeRunner(resolve(f"{style.__module__}:{style.__name__}"))
    records = [make_record(runner.run(row), privileged=True) for row in rows]
    runner.close()
    assert len(records) == 2 * len(TYPES)
    assert all(record.row["scd"] for record in records)
