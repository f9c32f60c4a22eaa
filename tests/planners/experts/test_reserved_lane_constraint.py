"""`idm` and `idm-e` where the ego's lane becomes one for buses or cyclists."""

from __future__ import annotations

import pytest
from labelled import CASES
from planner_loop import Body, World, constant, front_of, verdict

from tsbench.planners.base import Control, PlannerContext
from tsbench.planners.experts.expert import Expert
from tsbench.planners.idm import Idm
from tsbench.planners.lane_change import pursue_route
from tsbench.planners.observation import Observation
from tsbench.roads.lane_graph import Destination
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import ReservedLaneParams
from tsbench.sim.world import ActorKind

NETS = CASES / "nets"
SAME, AGAINST = read_network(NETS / "reserved.net.xml"), read_network(NETS / "contraflow.net.xml")
CODES = {"5.14.1": SAME, "5.14.2": SAME, "5.11.1": AGAINST, "5.11.2": AGAINST}


def target_plate(code: str) -> SignInstance:
    params = ReservedLaneParams(("bc",), "ab", ("bc_0" if code.startswith("5.14") else "cb_0",))
    return SignInstance("sign_0", code, None, "bc", -1, 0.0, 0.0, 0.0, 0.0, "target", None, params)


def world(code: str, *bodies: Body, speed: float = 10.0, start: float = 20.0) -> World:
    network: RoadNetwork = CODES[code]
    lane, goal = ("ab_0", Destination("cd", 40.0)) if network is SAME else ("ab_2", Destination("bc", 80.0))
    return World(network, lane, start, speed, goal, bodies=list(bodies), target=target_plate(code))


def user(code: str) -> Body:
    """Somebody who uses the reserved lane."""
    bus = code.endswith(".1")
    lanes = ("bc_0", "cd_0") if code.startswith("5.14") else ("cb_0",)
    return Body(
        "user", lanes, 15.0, constant(8.5 if bus else 4.5), tuple(i[:-2] for i in lanes),
        ActorKind.BUS if bus else ActorKind.BICYCLE, 12.0 if bus else 1.8, 2.55 if bus else 0.65,
    )  # fmt: skip


@pytest.mark.parametrize("code", CODES)
def test_the_sign_blind_driver_is_tempted(code: str) -> None:
    v = verdict(world(code).run(Idm(), 40.0))
    assert v.engaged
    assert [e.clause for e in v.violations] == ["in_reserved_lane"]


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("speed", [3.61, 7.75, 11.05])
def test_the_expert_changes_lane_before_the_plate_and_arrives(code: str, speed: float) -> None:
    w = world(code, user(code), speed=speed).run(Expert(Idm()), 60.0)
    v = verdict(w)
    assert (w.arrived, v.engaged, v.violations) == (True, True, ())
    assert all(e.on_road for e in w.states)
    assert min(e.speed for e in w.states) > 3.0  # a free lane beside is no reason to stop


@pytest.mark.parametrize("code", ["5.14.1", "5.11.2"])
def test_waits_before_the_plate_while_the_lane_beside_is_full(code: str) -> None:
    beside = ("ab_1", "bc_1", "cd_1") if code == "5.14.1" else ("ab_1", "bc_1")
    # A column beside the ego at its own pace, which then draws away.
    column = [
        Body(f"car{k}", beside, 2.0 + 8.0 * k, lambda t, w: min(w.ego.speed, 9.0) if t < 8.0 else 12.0)
        for k in range(9)
    ]
    w = world(code, *column, speed=8.0, start=12.0).run(Expert(Idm()), 60.0)
    v = verdict(w)
    assert (w.arrived, v.violations) == (True, ())
    network = CODES[code]
    first = network.lane("ab_0" if code == "5.14.1" else "ab_2")
    own = [e for e in w.states if e.lane == first.index]
    assert max(front_of(e) for e in own) < first.line.length - 5.0
    assert min(e.speed for e in own) < 6.0


@pytest.mark.parametrize("code", ["5.14.2", "5.11.1"])
def test_whoever_starts_beside_is_left_alone(code: str) -> None:
    """Where navigation keeps out of the lane, the guard has nothing to do."""
    network = CODES[code]
    goal = Destination("cd", 40.0) if network is SAME else Destination("bc", 80.0)
    free = World(network, "ab_1", 20.0, 10.0, goal, target=target_plate(code)).run(Idm(), 40.0)
    led = World(network, "ab_1", 20.0, 10.0, goal, target=target_plate(code)).run(Expert(Idm()), 40.0)
    assert led.states == free.states
    assert verdict(led).violations == ()


class _OwnWay:
    """Follows what it is shown, at a speed of its own."""

    def reset(self, context: PlannerContext) -> None:
        assert context.privilege is None

    def act(self, o: Observation) -> Control:
        return Control(9.0 - o.ego.speed, pursue_route(o))


@pytest.mark.parametrize("code", CODES)
def test_leads_any_base(code: str) -> None:
    w = world(code).run(Expert(_OwnWay()), 40.0)
    assert (w.arrived, verdict(w).violations) == (True, ())
