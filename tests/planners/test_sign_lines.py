"""Where plates and their lines are for a planner, against the monitors, in the dev split's nominal scenes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from simworld import simulation

from tsbench.episode.episode import Episode
from tsbench.episode.perception_level import Perception
from tsbench.planners.base import PlannerContext
from tsbench.planners.helpers import line_ahead, sign_ahead
from tsbench.planners.idm import Idm
from tsbench.planners.observation import Observation, SignView
from tsbench.rules.lines import ApproachLine
from tsbench.rules.monitors import NullMonitor
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import EGO_LENGTH_M, EgoState

TICKS = range(0, 200, 10)
_WIDE_BEND_M = 2.6


@dataclass(frozen=True)
class Look:
    """A plate as it is told at one tick. judged: m from the front to the line as the monitor of the target has it."""

    scenario: str
    sign: SignView
    reference: str
    on_route: bool
    ahead: float
    line: float
    place: float
    judged: float | None


def judged(monitor: Any, ego: EgoState) -> float | None:
    """Metres from the ego's front to where a monitor begins to judge; None where the ego does not drive there.

    None too where the target of a contrast scene binds nobody who is watched.
    """
    if isinstance(monitor, NullMonitor):
        return None
    line: Any = getattr(monitor, "line", getattr(monitor, "_line", None))
    if isinstance(line, ApproachLine):
        return line.to_go(ego)
    zone = getattr(monitor, "_zone", None)
    road = monitor._road if zone is None else zone.road
    begins = (getattr(monitor, name, None) for name in ("_line", "_plate", "_begin"))
    begin: float = zone.start if zone is not None else next(at for at in begins if at is not None)
    front: float | None = road.front(ego)
    return None if front is None else begin - front


def looks_of(loader: SceneLoader, row: ScenarioSpec) -> Iterator[Look]:
    planner, episode = Idm(), Episode(row, simulation=simulation(), loader=loader)
    context = episode.context
    planner.reset(context)
    target = episode.scene.target_signs[0]
    for tick in range(TICKS.stop):
        if episode.result is not None:
            return
        o = episode.observation
        for sign in (s for s in o.signs if s.code) if tick in TICKS else ():
            own = (sign.x, sign.y, sign.code) == (target.x, target.y, target.code)
            yield Look(
                row.scenario_id, sign, load_catalog().sign(sign.code).placement.reference,
                sign.edge in o.route.path.edges, sign_ahead(o, sign), line_ahead(context, o, sign),
                _place(context, o, sign),
                judged(episode.monitors.targets[0], episode.snapshots[-1].ego) if own else None,
            )  # fmt: skip
        episode.step(planner.act(o))


def _place(context: PlannerContext, o: Observation, sign: SignView) -> float:
    """Where `edge` and `position_m` put a plate, along the route from the ego's front."""
    lanes = [context.network.lanes[piece.lane] for piece in o.route.path.pieces]
    lane = next((lane for lane in lanes if lane.edge == sign.edge), None)
    if lane is None:
        return math.nan
    return o.route.path.line.project(*lane.line.point_at(sign.position_m))[0] - o.route.s - EGO_LENGTH_M / 2


@pytest.fixture(scope="module")
def looks() -> list[Look]:
    loader = SceneLoader(DataSet())
    rows = [row for row in DataSet().table("dev") if row.variant == 0]
    return [look for row in rows for look in looks_of(loader, row)]


def wide(look: Look) -> bool:
    """In bends of these wide roads a post stands metres from its plate's place on the ego's lane, the farthest one."""
    return look.scenario.startswith(("bus_lane_road", "bike_lane_road"))


@pytest.mark.slow
def test_sign_ahead_is_the_way_to_the_plates_place(looks: list[Look]) -> None:
    far = [
        look for look in looks if look.on_route and abs(look.ahead - look.place) > (_WIDE_BEND_M if wide(look) else 0.1)
    ]
    assert far == []


@pytest.mark.slow
def test_a_junctions_line_is_three_metres_behind_the_plate(looks: list[Look]) -> None:
    junction = [look for look in looks if look.on_route and look.reference == "line" and look.judged is not None]
    assert len({look.sign.code for look in junction}) > 12
    assert [look.line - look.ahead for look in junction] == pytest.approx([3.0] * len(junction), abs=0.05)


@pytest.mark.slow
def test_line_ahead_is_what_the_monitor_judges(looks: list[Look]) -> None:
    seen = [look for look in looks if look.on_route and look.judged is not None]
    assert {look.reference for look in seen} == {"line", "exit_start", "crossing", "obstacle", "own_line"}
    off = [(abs(look.line - look.judged), wide(look)) for look in seen if look.judged is not None]
    usual = [one for one, in_bend in off if not in_bend]
    # On the curve through a junction front and centre are on no straight line.
    assert max(usual) < 0.4
    assert sum(one > 0.05 for one in usual) < len(usual) / 50
    assert max(one for one, _ in off) < _WIDE_BEND_M


@pytest.mark.slow
def test_plates_beside_another_road_are_told_by_their_edge_alone(looks: list[Look]) -> None:
    others = [look for look in looks if not look.on_route]
    assert any(math.isfinite(look.ahead) for look in others), "sign_ahead alone does not tell"
    assert all(look.line == math.inf for look in others)


def test_a_masked_plate_has_no_line() -> None:
    row = next(row for row in DataSet().table("dev") if row.scenario_type == "stop")
    episode = Episode(row, perception=Perception(masked=True), simulation=simulation())
    context, o = episode.context, episode.observation
    assert o.signs
    assert {line_ahead(context, o, sign) for sign in o.signs} == {math.inf}
