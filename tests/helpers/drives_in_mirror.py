"""A drive and its image in the mirror: the same commands with the wheel turned the other way, compared tick by tick."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from simworld import simulation

from tsbench import Control
from tsbench.episode.episode import Episode
from tsbench.episode.outcome import EpisodeFacts, EpisodeResult
from tsbench.planners.registry import resolve
from tsbench.rules.monitor import Violation
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.mirror import mirrored_row
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.catalog import load_catalog, mirrored_code
from tsbench.sim.world import ActorKind, WorldSnapshot

Place = tuple[float, float, int]

IMAGE = DataSet(mirrored=True)
EGO_M = 1e-6
# What SUMO rounds another way adds up: one car of 108 drives, after 30 s.
CAR_M = 0.05
# Its pedestrians dodge each other to the same side wherever traffic keeps to: their way along a crossing is the same.
# A car that waits for one starts a little earlier or later: 1.9 m in three pairs of forty over crosswalks.
WALKER_M = 2.0
# One who dodged is a little behind: by 0.1 m in two drives of forty over crosswalks.
WALKER_ALONG_M = 0.15
WORDS = ("rule", "clause", "sign_id", "start_s", "end_s", "speed", "value", "threshold", "margin", "unit", "other")


def drive(spec: ScenarioSpec, name: str, said: list[Control]) -> EpisodeResult:
    """An episode; what its planner said is added to `said`."""
    planner = resolve(name)
    driver = planner.factory()
    episode = Episode(spec, planner=name, privileged=planner.privileged, simulation=simulation())
    driver.reset(episode.context)
    while episode.result is None:
        said.append(driver.act(episode.observation))
        episode.step(said[-1])
    return episode.result


def replay(spec: ScenarioSpec, privileged: bool, said: list[Control]) -> EpisodeResult:
    """The same commands with the steering wheel turned the other way."""
    loader = SceneLoader(IMAGE)
    episode = Episode(spec, planner="mirrored", privileged=privileged, simulation=simulation(), loader=loader)
    for command in said:
        episode.step(replace(command, steering=-command.steering))
    assert episode.result is not None, f"{spec.scenario_id}: goes on where the other drive ended"
    return episode.result


def in_mirror(heading: float) -> float:
    return math.remainder(math.pi - heading, 2.0 * math.pi)


def users(snapshot: WorldSnapshot) -> tuple[dict[str, Place], dict[str, Place]]:
    """Vehicles and pedestrians by id: x, y, lane."""
    found: tuple[dict[str, Place], dict[str, Place]] = ({}, {})
    a = snapshot.actors
    rows = zip(a.index.tolist(), a.kind.tolist(), a.pose.tolist(), a.lane.tolist(), strict=True)
    for row, kind, (x, y, _), lane in rows:
        found[kind == ActorKind.PEDESTRIAN][a.table.ids[row]] = (x, y, lane)
    return found


def assert_same_world(a: WorldSnapshot, b: WorldSnapshot, walked: bool) -> None:
    """One tick of a drive and of its mirror image; walked: has a pedestrian been there?"""
    assert (b.ego.x, b.ego.y) == pytest.approx((-a.ego.x, a.ego.y), abs=EGO_M)
    assert (b.ego.lane, b.ego.on_road) == (a.ego.lane, a.ego.on_road)
    assert (b.ego.s, b.ego.d) == pytest.approx((a.ego.s, -a.ego.d), abs=EGO_M)
    cars, walkers = zip(users(a), users(b), strict=True)
    assert walked or cars[0].keys() == cars[1].keys()
    # Some arrive where they go a moment earlier.
    for name in cars[0].keys() & cars[1].keys():
        x, y, lane = cars[0][name]
        assert walked or lane == cars[1][name][2]
        assert math.dist((-x, y), cars[1][name][:2]) <= (WALKER_M if walked else CAR_M), (a.step, name)
    for name in walkers[0].keys() & walkers[1].keys():
        x, y, _ = walkers[0][name]
        assert math.dist((-x, y), walkers[1][name][:2]) <= WALKER_M, (a.step, name)


def evidence(facts: EpisodeFacts) -> list[Violation]:
    said = facts.verdicts
    return [e for verdict in (*said.targets, *said.others) for e in verdict.violations] + [*said.needless]


def assert_same_evidence(a: EpisodeFacts, b: EpisodeFacts) -> None:
    signs = load_catalog().signs
    assert (a.verdicts.engaged, len(evidence(a))) == (b.verdicts.engaged, len(evidence(b)))
    for one, other in zip(evidence(a), evidence(b), strict=True):
        assert other.sign_code == mirrored_code(signs, one.sign_code)
        # A turn's value has a sign: left is positive.
        facts = [[abs(v) if isinstance(v := getattr(e, word), float) else v for word in WORDS] for e in (one, other)]
        exact = WALKER_ALONG_M if one.rule == "crosswalk" else EGO_M
        assert facts[0] == pytest.approx(facts[1], abs=exact), (one.sentence, other.sentence)
        assert (other.x, other.y) == pytest.approx((-one.x, one.y), abs=EGO_M)
        assert abs(math.remainder(other.heading - in_mirror(one.heading), 2.0 * math.pi)) < EGO_M


def compared(row: ScenarioSpec, name: str) -> EpisodeResult:
    """The drive of a planner; fails where the image of the drive has another world, outcome or event at any tick."""
    said: list[Control] = []
    result = drive(row, name, said)
    image = replay(mirrored_row(row, IMAGE.catalog), resolve(name).privileged, said)
    assert image.outcome == result.outcome, (row.scenario_id, image.error)
    assert result.facts is not None
    assert image.facts is not None
    assert len(image.facts.snapshots) == len(result.facts.snapshots)
    walked = False
    for tick, other in zip(result.facts.snapshots, image.facts.snapshots, strict=True):
        walked = walked or bool(users(tick)[1])
        assert_same_world(tick, other, walked)
    assert_same_evidence(result.facts, image.facts)
    return result
