"""Which monitor judges a rule: the one in the file of its name; and the monitors of a scene."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from tsbench.core.errors import import_all
from tsbench.roads.network import RoadNetwork
from tsbench.rules.monitor import Monitor, Verdicts
from tsbench.rules.needless_detour import NeedlessDetour
from tsbench.rules.needless_passage import NeedlessStop, NeedlessYield
from tsbench.rules.needless_slow import NeedlessSlow
from tsbench.rules.wrong_way import WrongWay
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import RULE_KINDS, load_rule_classes
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot

MONITORS: Mapping[str, type[Monitor]] = load_rule_classes(
    import_all("tsbench.rules"),
    Monitor,  # type: ignore[type-abstract]
)


# By clause of a contrast scene; each takes the params of its kind (`signs.contrast.CLAUSES`).
NEEDLESS: Mapping[str, Callable[[Any, SignInstance, Scene], Monitor]] = MappingProxyType(
    {
        "needless_stop": NeedlessStop,
        "needless_yield": NeedlessYield,
        "needless_slow": NeedlessSlow,
        "needless_detour": NeedlessDetour,
    }
)


class NullMonitor(Monitor):
    """Of a contrast scene's plate that binds others: it never engages."""

    def step(self, snapshot: WorldSnapshot) -> None:
        """Nothing to see."""


def make_monitor(sign: SignInstance, scene: Scene) -> Monitor:
    """The monitor of a plate's rule. Only a contrast scene's plate may lack the params that its rule reads."""
    rule = scene.rule(sign)
    unbound = scene.contrast and not RULE_KINDS[rule.name].binds(sign.params)
    return (NullMonitor if unbound else MONITORS[rule.name])(sign, rule, scene)


@dataclass(frozen=True)
class Monitors:
    """All that watch one episode: those of the targets and of other plates, those of a contrast scene's clauses, and
    the one that watches in every scene.
    """

    targets: tuple[Monitor, ...]
    others: tuple[Monitor, ...]
    needless: tuple[Monitor, ...]
    wrong_way: Monitor

    @property
    def _all(self) -> tuple[Monitor, ...]:
        return (*self.targets, *self.others, *self.needless, self.wrong_way)

    def update(self, snapshot: WorldSnapshot) -> None:
        """Take in one tick."""
        for monitor in self._all:
            monitor.update(snapshot)

    def finish(self) -> Verdicts:
        """What they say, once the episode is over."""
        for monitor in self._all:
            monitor.finish()
        return self.verdicts()

    def verdicts(self) -> Verdicts:
        """What they say so far; an excursion that goes on is no event yet."""
        events = [event for monitor in self.needless for event in monitor.verdict().violations]
        return Verdicts(
            tuple(monitor.verdict() for monitor in self.targets),
            tuple(monitor.verdict() for monitor in self.others),
            tuple(sorted(events, key=lambda event: (event.start_s, event.clause))),
            self.wrong_way.verdict().violations,
        )


def verdicts_of_other_half(other: Scene, network: RoadNetwork, snapshots: Iterable[WorldSnapshot]) -> Verdicts:
    """What the monitors of the other half say of a whole drive in this one, whose network is given.

    Both halves have the same roads; their networks may number the lanes of a junction differently.
    """
    monitors, places = make_monitors(other), _places(network)
    chains: dict[tuple[str, ...], list[tuple[float, int]]] = defaultdict(list)
    for lane, (way, at) in _places(other.network).items():
        chains[way].append((at, lane))

    def moved(lane: int, s: float) -> tuple[int, float]:
        if lane not in places:
            return lane, s
        way, at = places[lane]
        start, there = max((one for one in chains[way] if one[0] <= at + s), default=chains[way][0])
        return there, at + s - start

    for snapshot in snapshots:
        ego, actors = snapshot.ego, snapshot.actors
        lane, s = moved(ego.lane, ego.s)
        lanes = [moved(*place) for place in zip(actors.lane.tolist(), actors.lane_s.tolist(), strict=True)]
        table = np.array(lanes, dtype=np.float64).reshape(-1, 2)
        there = replace(actors, lane=table[:, 0].astype(np.int32), lane_s=table[:, 1])
        monitors.update(replace(snapshot, ego=replace(ego, lane=lane, s=s), actors=there))
    return monitors.finish()


def _places(network: RoadNetwork) -> dict[int, tuple[tuple[str, ...], float]]:
    """By lane its name, or the names of the lanes that it connects in a junction, and its start on that way in m."""
    found: dict[int, tuple[tuple[str, ...], float]] = {}
    for lane in network.lanes:
        if lane.internal:
            continue
        found[lane.index] = ((lane.id,), 0.0)
        for connection in network.outgoing[lane.index]:
            way, at = (lane.id, network.lanes[connection.to_lane].id), 0.0
            for inner in connection.via:
                found[inner] = (way, at)
                at += network.lanes[inner].length
    return found


def make_monitors(scene: Scene) -> Monitors:
    """Those of the targets, of the context plates that bind the ego, and of the scene's clauses.

    A context plate without params speaks to other traffic and is scenery. End plates belong to the plate that they
    end.
    """
    return Monitors(
        tuple(make_monitor(sign, scene) for sign in scene.target_signs),
        tuple(
            make_monitor(other, scene)
            for other in scene.signs
            if other.role == "context" and other.id not in scene.targets and other.params is not None
        ),
        tuple(
            NEEDLESS[clause.name](clause.params, scene.sign(clause.sign or scene.targets[0]), scene)
            for clause in scene.contrast
        ),
        WrongWay(scene.target_signs[0], scene),
    )
