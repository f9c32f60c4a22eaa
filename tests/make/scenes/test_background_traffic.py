"""Who stands and drives where: clear of the ego, never by a forbidden turn."""

from __future__ import annotations

import shutil
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from simworld import CALM, SceneMaker, plate, simulation

from tsbench.make.scenes.plate_roads import Sent, plate_roads, shut_roads
from tsbench.make.scenes.scene_files import (
    CYCLE_S,
    DENSITY_WINDOW_S,
    EVERY_TICKS,
    GREEN_S,
    LEAST_HEADWAY_S,
    DemandCalibration,
    lead_time,
)
from tsbench.make.scenes.traffic import (
    Car,
    Driver,
    Router,
    TrafficRequest,
    avoidable,
    background,
    driver_types,
    lane_km,
    standing_cars,
    write_additional,
)
from tsbench.roads.lane_graph import Destination, LaneGraph
from tsbench.roads.network import RoadNetwork
from tsbench.signs.catalog import load_catalog
from tsbench.sim.scene import EgoStart

QUICK = Driver(speed=14.0, accel=2.0, decel=2.5, headway=1.2, gap=2.0, length=4.5, width=1.8)
FORBIDDEN = frozenset({("w_in", "n_out"), ("s_in", "n_out"), ("e_in", "w_out")})


def ask(per_km: float, start: EgoStart, **more: object) -> TrafficRequest:
    plain = TrafficRequest(per_km, (CALM, QUICK), start, frozenset(), frozenset(), (), frozenset())
    return replace(plain, **more)  # type: ignore[arg-type]


@given(
    seed=st.integers(0, 2**32 - 1),
    per_km=st.floats(5.0, 40.0),
    s=st.floats(10.0, 130.0),
    speed=st.floats(0.0, 14.0),
    cut=st.floats(20.0, 140.0),
)
def test_nobody_stands_near_the_ego_nor_where_it_was_forbidden(
    on_cross: SceneMaker, seed: int, per_km: float, s: float, speed: float, cut: float
) -> None:
    network = on_cross.network
    graph = LaneGraph(network)
    request = ask(
        per_km, EgoStart("w_in_0", s, speed), avoid_turns=FORBIDDEN, quiet_edges=frozenset({"n_in"}),
        blocked=(("e_in_0", cut, 200.0),), closed_edges=frozenset({"s_in"}),
    )  # fmt: skip
    cars = standing_cars(network, graph, request, np.random.default_rng(seed))
    assert [c.id for c in cars] == [f"bg_{k:03d}" for k in range(len(cars))]
    for car in cars:
        assert car.position is not None
        assert car.depart == 0.0
        assert car.edges[0] not in ("n_in", "s_in")
        assert not set(pairwise(car.edges)) & FORBIDDEN
        assert all(b in graph.successors(a) for a, b in pairwise(car.edges))
        lane = network.edge_lanes(car.edges[0])[car.lane]
        assert 6.0 < car.position < lane.line.length - 2.0
        if lane.id == "e_in_0":
            assert car.position < cut
        if lane.id == "w_in_0":
            ahead = car.position - s
            assert ahead < -40.0 or ahead > max(20.0, 3.0 * speed)
    by_lane: dict[tuple[str, int], list[float]] = {}
    for car in cars:
        by_lane.setdefault((car.edges[0], car.lane), []).append(float(car.position or 0.0))
    for at in by_lane.values():
        assert all(b - a >= 9.0 - 1e-9 for a, b in pairwise(at))


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1), lane=st.sampled_from([0, 1, 2]), s=st.floats(10.0, 290.0), speed=st.floats(0, 14)
)
def test_beside_the_ego_twelve_metres_are_free(
    on_road: SceneMaker, seed: int, lane: int, s: float, speed: float
) -> None:
    network = on_road.network
    request = ask(30.0, EgoStart(f"road_{lane}", s, speed))
    for car in standing_cars(network, LaneGraph(network), request, np.random.default_rng(seed)):
        ahead = float(car.position or 0.0) - s
        if car.lane == lane:
            assert ahead < -40.0 or ahead > max(20.0, 3.0 * speed)
        else:
            assert abs(ahead) > 12.0


def test_walks_go_on_to_the_end_and_never_in_circles(block: RoadNetwork) -> None:
    graph, rng = LaneGraph(block), np.random.default_rng(1)
    router = Router(graph, frozenset({("ab", "bu")}))
    ways = [router.walk("ta", rng) for _ in range(200)]
    for way in ways:
        assert len(set(way)) == len(way)
        assert ("ab", "bu") not in set(pairwise(way))
        options = [e for e in graph.successors(way[-1]) if (way[-1], e) != ("ab", "bu") and e not in way]
        assert not options
    straight_on = sum(w[1] == "ab" for w in ways) / len(ways)
    assert straight_on == pytest.approx(0.8, abs=0.08)


def test_the_same_seed_gives_the_same_cars(on_cross: SceneMaker) -> None:
    network, graph = on_cross.network, LaneGraph(on_cross.network)
    request = ask(18.0, EgoStart("w_in_0", 40.0, 8.0))
    one, two, other = (standing_cars(network, graph, request, np.random.default_rng(k)) for k in (4, 4, 5))
    assert one == two != other


class Rehearsal:
    """DemandCalibration on the crossroads for thirty seconds."""

    def __init__(self, made: SceneMaker, folder: Path, target: float, **more: object) -> None:
        network, graph = made.network, LaneGraph(made.network)
        request = ask(target, EgoStart("w_in_0", 70.0, 8.0), **more)
        rng = np.random.default_rng(11)
        self.standing = standing_cars(network, graph, request, rng)
        self.types = driver_types([CALM, QUICK])
        self.path = folder / "trial.add.xml.gz"
        self.made = made
        write_additional([*self.types, *background(self.standing)], self.path)
        simulation().load(made.net, self.path, network, 3)
        self.asked = target * lane_km(network, request.closed_edges)
        inflow = DemandCalibration(simulation(), network, graph, request, self.standing, self.asked, rng)
        self.mean = inflow.drive(40.0)
        self.inflow = inflow
        self.cars: list[Car] = inflow.cars
        self.entered = self.cars[len(self.standing) :]


@pytest.fixture(scope="module")
def rehearsal(on_cross: SceneMaker, tmp_path_factory: pytest.TempPathFactory) -> Rehearsal:
    return Rehearsal(on_cross, tmp_path_factory.mktemp("rehearsal"), 14.0, avoid_turns=FORBIDDEN)


def test_who_drives_out_is_replaced(rehearsal: Rehearsal) -> None:
    assert len(rehearsal.entered) > 5
    assert rehearsal.mean == pytest.approx(rehearsal.asked, rel=0.1)
    assert rehearsal.cars[: len(rehearsal.standing)] == rehearsal.standing


def test_no_car_enters_while_it_is_quiet_nor_by_a_closed_edge(
    on_cross: SceneMaker, tmp_path: Path, rehearsal: Rehearsal
) -> None:
    closed = frozenset({"s_in"})
    quiet = Rehearsal(on_cross, tmp_path, 14.0, avoid_turns=FORBIDDEN, quiet_s=8.0, closed_edges=closed)
    assert min(car.depart for car in rehearsal.entered) < 4.0
    assert 8.0 < min(car.depart for car in quiet.entered) < 10.0
    assert {c.edges[0] for c in rehearsal.entered} - {c.edges[0] for c in quiet.entered} == closed
    # The mean is that of the time in which cars come.
    assert quiet.mean == pytest.approx(quiet.asked, rel=0.15)


def test_entries_keep_a_headway_and_forbidden_turns_are_not_routed(rehearsal: Rehearsal) -> None:
    last: dict[str, float] = {}
    for car in rehearsal.entered:
        assert car.position is None
        assert car.edges[0].endswith("_in")
        assert not set(pairwise(car.edges)) & FORBIDDEN
        assert car.depart - last.get(car.edges[0], -9.0) >= LEAST_HEADWAY_S - 0.2
        last[car.edges[0]] = car.depart
    behind_ego = [c.depart for c in rehearsal.entered if c.edges[0] == "w_in"]
    assert min(behind_ego) >= 4.0


def test_what_was_rehearsed_happens_again(rehearsal: Rehearsal) -> None:
    """The departures that were written down give the density that was seen when they were found."""
    made = rehearsal.made
    write_additional([*rehearsal.types, *background(rehearsal.cars)], rehearsal.path)
    sim, counts = simulation(), []
    sim.load(made.net, rehearsal.path, made.network, 3)
    for tick in range(round(DENSITY_WINDOW_S * 10)):
        sim.step()
        if tick % EVERY_TICKS == 0:
            counts.append(sum(not lane.startswith(":") for _, lane, _ in sim.fleet()))
    assert np.mean(counts) == pytest.approx(rehearsal.mean, rel=0.01)


def test_a_turn_is_jammed_where_a_car_stands_at_its_line_for_half_a_minute(on_cross: SceneMaker) -> None:
    network, graph = on_cross.network, LaneGraph(on_cross.network)
    cars = [Car(f"bg_{k:03d}", 0, 0.0, ("w_in", "n_out"), 0, 10.0) for k in range(3)]
    request = ask(10.0, EgoStart("e_in_0", 50.0, 8.0))
    inflow = DemandCalibration(simulation(), network, graph, request, cars, 3.0, np.random.default_rng(1))
    line = network.edge_lanes("w_in")[0].line.length
    for now in (0.0, 29.0):
        inflow._watch("bg_000", "w_in_0", line - 2.0, now)
        inflow._watch("bg_001", "w_in_0", line - 30.0, now)
        inflow._watch("bg_002", "w_in_0", line - 40.0 + now, now)
    assert not inflow.jammed
    for k, place in enumerate((2.0, 30.0, 10.0)):
        inflow._watch(f"bg_00{k}", "w_in_0", line - place, 31.0)
    # The others stand behind it, or come on.
    assert inflow.jammed == {("w_in", "n_out")}


def test_turns_are_avoidable_as_long_as_a_way_on_is_left(on_cross: SceneMaker) -> None:
    graph = LaneGraph(on_cross.network)
    ways = sorted(("w_in", e) for e in graph.successors("w_in"))
    assert avoidable(set(ways[:1]), graph, frozenset()) == {ways[0]}
    assert avoidable(set(ways), graph, frozenset()) == set(ways[:-1])
    assert avoidable({ways[0]}, graph, frozenset(ways[1:])) == frozenset()


def test_a_road_is_shut_with_those_that_lead_to_the_egos_ways_alone(block: RoadNetwork) -> None:
    roads, road = plate_roads(LaneGraph(block), load_catalog().distances), ("bc", "cd", "da")
    none = Sent(frozenset(), frozenset())
    into = {("ab", "bc"), ("ub", "bc")}
    assert shut_roads(roads, [road], ego={"ta", "ab", "bu"}, sent=none) == Sent(frozenset(into), frozenset(road))
    more = shut_roads(roads, [road], ego={"ub", "ba"}, sent=none)
    assert more == Sent(frozenset(into), frozenset(road))
    more = shut_roads(roads, [road], ego={"ba", "at"}, sent=none)
    assert more == Sent(frozenset(into), frozenset({*road, "ub"}))
    given = Sent(frozenset({("ab", "bu")}), frozenset())
    assert shut_roads(roads, [road], ego={"ta", "ab"}, sent=given) is None


def test_platoons_leave_gaps(on_cross: SceneMaker, tmp_path: Path) -> None:
    platoons = Rehearsal(on_cross, tmp_path, 25.0, platoons=frozenset({"w_in", "e_in"}))
    phase = platoons.inflow.phase
    assert 0.0 <= phase < CYCLE_S
    # A car departs a step after it was let in.
    at = {c.id: (c.depart - 0.1 + phase) % CYCLE_S for c in platoons.entered}
    main = [at[c.id] for c in platoons.entered if c.edges[0] in ("w_in", "e_in")]
    side = [at[c.id] for c in platoons.entered if c.edges[0] in ("s_in", "n_in")]
    assert main
    assert max(main) <= GREEN_S + 0.05
    assert max(side) > GREEN_S


def test_the_convoys_lead_is_timed_from_its_stand(on_cross: SceneMaker, tmp_path: Path) -> None:
    sign = plate(on_cross.network, "s_in", 139.0)
    spec = on_cross.make(
        "lead", EgoStart("s_in_0", 60.0, 8.0), Destination("n_out", 60.0), ("s_in", "n_out"), sign,
        convoy_at=("e_in_0", (100.0,), ("e_in", "w_out")),
    )  # fmt: skip
    times = [
        lead_time(simulation(), on_cross.net, on_cross.path(spec), on_cross.network, 7, way) for way in (5, 20, 45)
    ]
    assert times == sorted(times)
    # 1.5 m/s2 is CALM's most: no car is faster than that, and an IDM driver not much slower at first.
    assert (2 * 5 / 1.5) ** 0.5 <= times[0] <= (2 * 5 / 1.5) ** 0.5 * 1.4
    assert times[2] - times[1] >= 25.0 / CALM.speed
    # SUMO itself takes commas for the ends of names.
    folder = tmp_path / "a, b"
    folder.mkdir()
    net, additional = (Path(shutil.copy(file, folder)) for file in (on_cross.net, on_cross.path(spec)))
    assert lead_time(simulation(), net, additional, on_cross.network, 7, 20) == times[1]
