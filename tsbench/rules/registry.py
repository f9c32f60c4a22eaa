"""Which monitor judges a rule, and the monitors of a scene."""

from __future__ import annotations

from collections.abc import Mapping

from tsbench.rules.base import Monitor
from tsbench.rules.closed_road import ClosedRoad
from tsbench.rules.crosswalk import Crosswalk
from tsbench.rules.detour import Detour
from tsbench.rules.give_way import GiveWay
from tsbench.rules.manoeuvre import Manoeuvre
from tsbench.rules.min_speed import MinSpeed
from tsbench.rules.no_entry import NoEntry
from tsbench.rules.one_way_exit import OneWayExit
from tsbench.rules.reserved_lane import ReservedLane
from tsbench.rules.roundabout import Roundabout
from tsbench.rules.speed import Speed
from tsbench.rules.stop import Stop
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import Catalog
from tsbench.signs.rule_kinds import for_every_kind
from tsbench.sim.scene import Scene

MONITORS: Mapping[str, type[Monitor]] = for_every_kind(
    "monitor",
    {
        "give_way": GiveWay,
        "stop": Stop,
        "roundabout": Roundabout,
        "crosswalk": Crosswalk,
        "speed": Speed,
        "min_speed": MinSpeed,
        "detour": Detour,
        "closed_road": ClosedRoad,
        "manoeuvre": Manoeuvre,
        "one_way_exit": OneWayExit,
        "no_entry": NoEntry,
        "reserved_lane": ReservedLane,
    },
)


def make_monitor(sign: SignInstance, catalog: Catalog, scene: Scene) -> Monitor:
    """The monitor of one plate."""
    rule = catalog.sign(sign.code).rule
    return MONITORS[rule.name](sign, rule, scene)


def make_monitors(catalog: Catalog, scene: Scene) -> tuple[Monitor, tuple[Monitor, ...]]:
    """The target's monitor, and those of the context plates that bind the ego.

    A context plate without params speaks to other traffic and is scenery. End plates belong to the plate that they
    end.
    """
    others = tuple(
        make_monitor(sign, catalog, scene)
        for sign in scene.signs
        if sign.role == "context" and sign.id != scene.target and sign.params is not None
    )
    return make_monitor(scene.target_sign, catalog, scene), others
