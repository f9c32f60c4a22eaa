"""One episode in the closed loop: every outcome, and what stands in its record."""

from __future__ import annotations

import importlib
import math
from dataclasses import replace
from pathlib import Path

import libsumo
import numpy as np
import pytest
from episode_builders import same_snapshots

from tsbench.core.seeds import floor_seed, planner_seed
from tsbench.episode import outcome as outcome_module
from tsbench.episode.outcome import EpisodeFacts, EpisodeResult, Outcome, Phase
from tsbench.episode.perception_level import Perception
from tsbench.episode.runner import EpisodeRunner
from tsbench.make.scenes.scene_files import lead_time
from tsbench.make.scenes.traffic import Car
from tsbench.planners.registry import resolve
from tsbench.roads.lane_graph import Destination
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.scene import ConvoyPlan, EgoStart, Obstacle
from tsbench.sim.world import EGO_LENGTH_M

# The hand-made scenes are shared with the tests of the simulation.
world = importlib.import_module("simworld")
scripted = importlib.import_module("scripted")

START = EgoStart("road_1", 20.0, 8.0)
END = Destination("road", 150.0)


@pytest.fixture(scope="module")
def root(net_folder: Path) -> Path:
    return net_folder


def runner(root: Path, planner: str, **more: object) -> EpisodeRunner:
    """A runner on the hand-made scenes, with the one simulation of this process."""
    shared = {"simulation": world.simulation(), "loader": world.loader_of(root)}
    return EpisodeRunner(resolve(f"scripted:{planner}"), **shared, **more)  # type: ignore[arg-type]


def on_the_road(on_road, name: str, start: EgoStart = START, end: Destination = END, **more: object) -> ScenarioSpec:
    sign = world.speed_plate(on_road.network, "road", 60.0)
    return on_road.make(name, start, end, ("road",), sign, **more)


def consistent(result: EpisodeResult, outcome: Outcome) -> EpisodeFacts:
    """Asserts that it ended so, and what holds for every episode that was simulated; its facts."""
    assert result.outcome is outcome
    facts = result.facts
    steps = [s.step for s in facts.snapshots]
    assert steps == list(range(len(steps)))
    assert len(result.commands) == len(result.planner_s)
    assert len(result.commands) in (len(steps) - 1, len(steps))
    assert facts.outcome is result.outcome
    for a, b in zip(facts.snapshots, facts.snapshots[1:], strict=False):
        assert b.time == pytest.approx(a.time + 0.1)
        moved = math.hypot(b.ego.x - a.ego.x, b.ego.y - a.ego.y)
        assert moved <= max(a.ego.speed, b.ego.speed) * 0.1 * 1.05 + 1e-9
    return facts


@pytest.mark.parametrize("planner", ["Follow", "FollowPoses"])
def test_arrived(root: Path, on_road, planner: str) -> None:
    result = runner(root, planner).run(on_the_road(on_road, "plain"))
    facts = consistent(result, Outcome.ARRIVED)
    assert (result.error, result.detail) == ("", "")
    last, before = facts.snapshots[-1].ego, facts.snapshots[-2].ego
    assert abs(last.s - 150.0) <= 5.0 < abs(before.s - 150.0)
    assert facts.route.remaining == pytest.approx(150.0 - last.s, abs=0.1)
    assert facts.start_remaining_m == pytest.approx(130.0, abs=0.1)
    assert facts.snapshots[0].ego.x == pytest.approx(20.0)
    assert len(facts.snapshots) == pytest.approx(1 + 125 / 0.8, abs=3)


def test_every_lane_of_the_destination_counts(root: Path, on_road) -> None:
    spec = on_the_road(on_road, "other-lane", EgoStart("road_0", 100.0, 8.0))
    assert runner(root, "Straight").run(spec).outcome is Outcome.ARRIVED


def test_collision_with_an_obstacle(root: Path, on_road) -> None:
    cones = world.obstacle(on_road.network, "road_1", 90.0)
    result = runner(root, "Straight").run(on_the_road(on_road, "cones", obstacles=[cones]))
    facts = consistent(result, Outcome.COLLISION)
    contact = facts.contact
    assert (contact.partner_kind, contact.partner, contact.at_fault) == ("obstacle", "obstacle_0", True)
    assert contact.step == facts.snapshots[-1].step
    gap = cones.x - cones.length / 2 - (facts.snapshots[-1].ego.x + EGO_LENGTH_M / 2)
    assert -2.3 <= gap <= 0.0


def test_collision_with_a_vehicle(root: Path, on_road) -> None:
    slow = replace(world.CALM, speed=1.0)
    cars = [Car("bg_000", 0, 0.0, ("road",), 1, 70.0)]
    spec = on_the_road(on_road, "slow", cars=cars, drivers=[slow])
    result = runner(root, "Straight").run(spec)
    facts = consistent(result, Outcome.COLLISION)
    assert (facts.contact.partner_kind, facts.contact.partner, facts.contact.at_fault) == ("vehicle", "bg_000", True)


def test_off_road_sideways(root: Path, on_road) -> None:
    result = runner(root, "Swerve").run(on_the_road(on_road, "plain"))
    facts = consistent(result, Outcome.OFF_ROAD)
    on_road_until = [s.ego.on_road for s in facts.snapshots]
    assert on_road_until == [True] * (len(on_road_until) - 1) + [False]


def test_off_the_end_of_the_map(root: Path, on_cross) -> None:
    sign = world.speed_plate(on_cross.network, "w_in", 60.0)
    start = EgoStart("w_in_0", 100.0, 10.0)
    spec = on_cross.make("over", start, Destination("n_out", 80.0), ("w_in", "n_out"), sign)
    result = runner(root, "Straight").run(spec)
    facts = consistent(result, Outcome.OFF_ROAD)
    assert facts.snapshots[-1].ego.x == pytest.approx(150.0, abs=2.3)


def test_timeout(root: Path, on_road) -> None:
    result = runner(root, "Stand").run(on_the_road(on_road, "short", horizon=30))
    facts = consistent(result, Outcome.TIMEOUT)
    assert len(facts.snapshots) == 31
    assert len(result.commands) == 30


def test_contact_wins_over_arrival_and_arrival_over_the_horizon(root: Path, on_road) -> None:
    there = Destination("road", 22.0)
    touching = Obstacle("obstacle_0", "cones", 24.0, 0.0, 0.0, 4.9, 0.5, "road_1")
    line = on_road.network.lane("road_1").line
    touching = replace(touching, y=line.point_at(24.0)[1])
    both = on_the_road(on_road, "both", end=there, obstacles=[touching])
    result = runner(root, "Follow").run(both)
    assert result.outcome is Outcome.COLLISION
    assert len(result.commands) == 0
    assert runner(root, "Follow").run(on_the_road(on_road, "here", end=there)).outcome is Outcome.ARRIVED
    plain = on_the_road(on_road, "exactly")
    full = runner(root, "Follow").run(plain)
    exact = runner(root, "Follow").run(replace(plain, horizon=len(full.commands)))
    assert exact.outcome is Outcome.ARRIVED
    late = runner(root, "Follow").run(replace(plain, horizon=len(full.commands) - 1))
    assert late.outcome is Outcome.TIMEOUT


@pytest.mark.parametrize(
    ("planner", "outcome", "words", "steps"),
    [
        ("RaisesReset", Outcome.PLANNER_ERROR, "RuntimeError: reset: no map", 0),
        ("RaisesAct", Outcome.PLANNER_ERROR, "KeyError: 'at step five'", 5),
        ("NotFinite", Outcome.INVALID_OUTPUT, "Control is not finite: acceleration nan", 3),
        ("Nothing", Outcome.INVALID_OUTPUT, "act returned NoneType", 0),
        ("WrongShape", Outcome.INVALID_OUTPUT, "(1, 2)", 0),
    ],
)
def test_what_a_planner_does_wrong_is_the_outcome_of_its_episode(
    root: Path, on_road, planner: str, outcome: Outcome, words: str, steps: int
) -> None:
    phases: list[int] = []
    made = runner(root, planner, heartbeat=phases.append)
    result = made.run(on_the_road(on_road, "plain"))
    assert (result.outcome, result.outcome.is_error) == (outcome, True)
    assert words in result.error
    assert "\n" not in result.error
    assert len(result.commands) == steps
    if outcome is Outcome.PLANNER_ERROR:
        assert "scripted.py" in result.detail
    assert (phases[0], phases[-1]) == (Phase.LOADING, Phase.IDLE)
    # The same process drives the next episode as if nothing had been.
    assert runner(root, "Follow").run(on_the_road(on_road, "plain")).outcome is Outcome.ARRIVED


def refused(on_road) -> dict[str, tuple[ScenarioSpec, str]]:
    good = on_the_road(on_road, "good")
    bad_car = [Car("bg_000", 0, 0.0, ("zz",), 0, 10.0)]
    unsigned = world.plate(on_road.network, "road", 60.0, "2.4")
    return {
        "hash": (replace(good, additional_sha256="0" * 64), "SHA-256 differs"),
        "file": (replace(good, net="gone.net.xml.gz"), "no such scene file"),
        "sumo": (on_the_road(on_road, "zz", cars=bad_car), "SUMO does not load the scene"),
        "sign": (on_road.make("unsigned", START, END, ("road",), unsigned), "sign_0"),
        "way": (on_the_road(on_road, "nowhere", EgoStart("road_1", 20.0, 30.0)), "Departure speed"),
    }


@pytest.mark.parametrize("what", ["hash", "file", "sumo", "sign", "way"])
def test_a_scene_that_does_not_load_is_a_sim_error_with_its_cause(root: Path, on_road, what: str) -> None:
    spec, words = refused(on_road)[what]
    made = runner(root, "Follow")
    result = made.run(spec)
    assert result.outcome is Outcome.SIM_ERROR
    assert words in result.error
    assert "\n" not in result.error
    assert result.facts is None
    assert made.run(on_the_road(on_road, "plain")).outcome is Outcome.ARRIVED


def test_a_defect_of_ours_is_an_error_with_its_traceback(root: Path, on_road, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> int:
        raise ZeroDivisionError("a monitor's slip")

    monkeypatch.setattr(outcome_module, "touched_actor", broken)
    result = runner(root, "Follow").run(on_the_road(on_road, "plain"))
    assert result.outcome is Outcome.SIM_ERROR
    assert result.error == "internal error: ZeroDivisionError: a monitor's slip"
    assert "in broken" in result.detail


def test_the_signs_that_a_planner_sees(root: Path, on_road) -> None:
    spec = on_the_road(on_road, "plain")
    runner(root, "Follow").run(spec)
    shown = scripted.Scripted.seen
    first = shown[0].signs[0]
    assert (first.code, first.value, first.edge, first.position_m) == ("3.24", 40.0, "road", 60.0)
    assert first.distance == pytest.approx(math.hypot(first.x - 20.0, first.y - shown[0].ego.y))
    assert [len(o.history) for o in (shown[0], shown[5], shown[40])] == [1, 6, 20]
    assert shown[40].history[-1].tolist() == [
        shown[40].ego.x, shown[40].ego.y, shown[40].ego.heading, shown[40].ego.speed
    ]  # fmt: skip
    with pytest.raises(ValueError, match="read-only"):
        shown[40].history[0, 0] = 0.0


def test_a_plate_beyond_a_hundred_metres_is_not_seen_yet(root: Path, on_road) -> None:
    sign = world.speed_plate(on_road.network, "road", 140.0)
    runner(root, "Follow").run(on_road.make("far", START, END, ("road",), sign))
    seen = [bool(o.signs) for o in scripted.Scripted.seen]
    assert seen[0] is False
    assert seen == sorted(seen)
    k = seen.index(True)
    assert scripted.Scripted.seen[k].signs[0].distance <= 100.0
    assert math.hypot(sign.x - scripted.Scripted.seen[k - 1].ego.x, sign.y - 0.0) > 95.0


def test_masked_signs_keep_their_place_only(root: Path, on_road) -> None:
    spec = on_the_road(on_road, "plain")
    bare = runner(root, "Follow").run(spec)
    plain = scripted.Scripted.seen[0].signs[0]
    masked = runner(root, "Follow", perception=Perception(masked=True)).run(spec)
    hidden = {s for o in scripted.Scripted.seen for s in ((x.code, x.value) for x in o.signs)}
    assert hidden == {("", None)}
    first = scripted.Scripted.seen[0].signs[0]
    left = replace(plain, code="", value=None, edge="", lane=-1, position_m=math.nan, outline="")
    assert repr(first) == repr(left)
    # The judge is not masked.
    assert bare.facts.verdicts == masked.facts.verdicts


def test_only_experts_are_told_the_rule(root: Path, on_road) -> None:
    spec = on_the_road(on_road, "plain")
    runner(root, "Follow").run(spec)
    runner(root, "Privileged").run(spec)
    plain, expert = scripted.Scripted.contexts[-2:]
    assert plain.privilege is None
    assert expert.privilege.signs[0].code == "3.24"
    assert plain.seed == expert.seed
    assert plain.seed == planner_seed(spec.pair_name)
    assert all(o.truth is not None for o in scripted.Scripted.seen)
    runner(root, "Follow").run(replace(spec, scenario_id="another", seed=8))
    assert scripted.Scripted.contexts[-1].seed != plain.seed
    assert all(o.truth is None for o in scripted.Scripted.seen)


def test_a_floor_gets_a_seed_of_its_row(root: Path, on_road) -> None:
    spec = on_the_road(on_road, "plain")
    loaded = replace(resolve("scripted:Follow"), floor=True)
    shared = {"simulation": world.simulation(), "loader": world.loader_of(root)}
    EpisodeRunner(loaded, **shared).run(spec)
    assert scripted.Scripted.contexts[-1].seed == floor_seed(spec.scenario_id) != planner_seed(spec.pair_name)


def test_one_planner_for_all_episodes_of_a_runner(root: Path, on_road) -> None:
    made = runner(root, "Follow")
    before, resets = scripted.Scripted.made, len(scripted.Scripted.contexts)
    for _ in range(3):
        made.run(on_the_road(on_road, "plain"))
    assert scripted.Scripted.made == before + 1
    assert len(scripted.Scripted.contexts) == resets + 3


def on_the_cross(on_cross, name: str, **more: object) -> ScenarioSpec:
    sign = world.speed_plate(on_cross.network, "w_in", 60.0)
    return on_cross.make(
        name, EgoStart("w_in_0", 60.0, 8.0), Destination("e_out", 60.0), ("w_in", "e_out"), sign, **more
    )


def test_others_go_by_what_the_ego_shows(root: Path, on_cross) -> None:
    """A car that waits at the side road for an ego straight on need not wait for one that indicates right."""
    side = [Car("bg_000", 0, 0.0, ("s_in", "n_out"), 0, 80.0)]
    spec = on_the_cross(on_cross, "shown", cars=side)
    entered = {}
    for planner in ("Follow", "IndicatesRight"):
        result = runner(root, planner).run(spec)
        ys = [float(s.actors.pose[0, 1]) for s in result.facts.snapshots if len(s.actors)]
        entered[planner] = next((k for k, y in enumerate(ys) if y > -3.2), len(ys))
    assert entered["IndicatesRight"] < entered["Follow"]


def test_sumo_is_told_the_way_again_where_it_has_forgotten_it(
    root: Path, on_block, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As when SUMO takes the ego for another path's inside a junction: who has no way on is seen by nobody."""
    sign, way = world.speed_plate(on_block.network, "ta", 60.0), ("ta", "ab", "bu")
    spec = on_block.make("forgotten", EgoStart("ta_0", 100.0, 8.0), Destination("bu", 20.0), way, sign)
    sim, routes = world.simulation(), {}
    step = sim.step

    def forgetful() -> None:
        step()
        if libsumo.vehicle.getRoadID("ego").startswith(":a"):
            libsumo.vehicle.setRoute("ego", ("ta", "ab"))
        routes[libsumo.vehicle.getRoadID("ego")] = libsumo.vehicle.getRoute("ego")

    monkeypatch.setattr(sim, "step", forgetful)
    assert runner(root, "Follow").run(spec).outcome is Outcome.ARRIVED
    assert routes["ab"][-1] == "bu"


def test_an_intent_that_does_not_connect_is_an_invalid_output(root: Path, on_cross) -> None:
    result = runner(root, "Indicates").run(on_the_cross(on_cross, "indicates"))
    assert result.outcome is Outcome.INVALID_OUTPUT


def test_two_runs_are_the_same_tick_by_tick(root: Path, on_road) -> None:
    cars = [Car(f"bg_{k:03d}", 0, 0.3 * k, ("road",), k % 3, 100.0 if k < 3 else None) for k in range(8)]
    spec = on_the_road(on_road, "busy", cars=cars)
    first = runner(root, "Follow").run(spec)
    runner(root, "Straight").run(on_the_road(on_road, "plain"))
    again = runner(root, "Follow").run(spec)
    assert again.facts is not None
    assert max(len(s.actors) for s in first.facts.snapshots) >= 5
    assert np.array_equal(first.commands, again.commands)
    same_snapshots(first.facts.snapshots, again.facts.snapshots)


def test_the_convoy_comes_when_the_ego_does(root: Path, on_cross) -> None:
    """From the south across the main road; the convoy from the east waits for its moment."""
    network, fronts = on_cross.network, (125.0, 115.0)
    sign = world.plate(network, "s_in", 139.0, "2.4", junction="x", approach="s_in", main_in="w_in e_in")
    start, end = EgoStart("s_in_0", 77.0, 7.75), Destination("n_out", 60.0)
    at = ("e_in_0", fronts, ("e_in", "w_out"))
    # The ego's line is the end of s_in; the conflict zone begins about 7 m further on both paths.
    zone = network.lane("e_in_0").line.length + 4.0
    draft = on_cross.make("draft", start, end, ("s_in", "n_out"), sign, convoy_at=at)
    seconds = lead_time(world.simulation(), on_cross.net, on_cross.path(draft), network, 7, zone - fronts[0])
    plan = ConvoyPlan("s_in_0", 7.0, seconds, 8.0, 8.0, ("convoy_0", "convoy_1"))
    spec = on_cross.make("convoy", start, end, ("s_in", "n_out"), sign, convoy=plan, convoy_at=at)
    result = runner(root, "Follow").run(spec)
    shots = result.facts.snapshots
    table = shots[-1].actors.table
    lead = [s.actors.index.tolist().index(table.rows["convoy_0"]) for s in shots]
    speed = [float(s.actors.speed[k]) for s, k in zip(shots, lead, strict=True)]
    moving = next(k for k, v in enumerate(speed) if v > 0.0)
    assert set(speed[:moving]) == {0.0}
    assert moving > 5
    # Undisturbed, the lead would now be at the zone when the ego is (this ego cuts in, and the lead brakes).
    line = network.lane("s_in_0").line
    zone_y = line.point_at(line.length)[1] + plan.ego_zone_m
    ego_in = next(k for k, s in enumerate(shots) if s.ego.y + EGO_LENGTH_M / 2 > zone_y)
    assert moving * 0.1 + seconds == pytest.approx(ego_in * 0.1, abs=0.8)
    assert min(speed[ego_in:]) < max(speed) - 1.0
