"""Give way to vehicles on the ring, and drive round it the right way. Units: m.

Source: docs/rules.md, "Give way".
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from tsbench.geometry.polyline import Polyline, join
from tsbench.roads.network import Connection, RoadNetwork
from tsbench.rules.give_way import GiveWay
from tsbench.rules.monitor import InAll
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import RuleSpec
from tsbench.signs.rule_kinds import RoundaboutParams
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot

_NOISE_M = 1e-6


class Roundabout(GiveWay):
    """A vehicle that still stands at another arm's line has no priority yet: it is not on the ring."""

    def __init__(self, sign: SignInstance, rule: RuleSpec, scene: Scene) -> None:
        self._ring_edges = sign.params_as(RoundaboutParams).ring
        super().__init__(sign, rule, scene)
        self._ring = Circulation(scene.network, self._ring_edges)
        self._last: tuple[float, float] | None = None
        self._wrong = InAll(self.excursion("wrong_direction"), rule.thresholds["wrong_way_m"])

    def lanes_with_priority(self) -> frozenset[int]:
        """Those of the ring and its junctions, entries' ways in among them, and of where the paths lead."""
        network, ring = self._network, self._ring_edges
        ordinary = {*ring, *(p.target.edge for p in self._priority_paths)}
        found = {i for edge in ordinary for i in network.edges[edge].lanes}
        found |= {v for c in network.connections if network.lanes[c.to_lane].edge in ring for v in c.via}
        return frozenset(found | {v for p in self._priority_paths for v in p.connection.via})

    def step(self, snapshot: WorldSnapshot) -> None:
        """One tick: right of way at the entry, direction wherever the centre is on the ring."""
        super().step(snapshot)
        ego = snapshot.ego
        last, self._last = self._last, (ego.x, ego.y)
        along = None if last is None else self._ring.along(ego.lane, last, self._last)
        if along is None or along > _NOISE_M:
            # It has left the ring, or turned round: what it does next is another excursion.
            self._wrong.keep()
        elif along < -_NOISE_M:
            self._wrong.add(snapshot, -along)


class Circulation:
    """The ring's line in driving order, and which lanes are on it."""

    def __init__(self, network: RoadNetwork, edges: tuple[str, ...]) -> None:
        lanes, chunks = network.lanes, []
        inner: set[int] = set()
        for one, other in pairwise((*edges, edges[0])):
            chunks.append(network.edge_lanes(one)[0].line)
            link = _links(network, one, other)
            chunks += [lanes[v].line for v in link[0].via] if link else []
            node = network.edges[one].target
            inner |= {v for e in network.edges.values() if e.target == node for v in _inside(network, e.lanes)}
        self._line: Polyline = join([*chunks, network.edge_lanes(edges[0])[0].line])
        self._lanes = frozenset(i for edge in edges for i in network.edges[edge].lanes)
        self._inner = frozenset(inner)
        # In a junction the ring is as wide as before it; the line is that of its outermost lane.
        widest = max(sum(lane.width for lane in network.edge_lanes(edge)) for edge in edges)
        self._outer = network.edge_lanes(edges[0])[0].width / 2
        self._inwards = widest - self._outer
        x, y = self._line.points.T
        self._island = math.copysign(1.0, float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])))

    def along(self, lane: int, last: tuple[float, float], here: tuple[float, float]) -> float | None:
        """Way along the ring between two places, < 0 against the circulation; None off the ring."""
        if lane not in self._lanes and lane not in self._inner:
            return None
        s, d = self._line.project(*here)
        if lane in self._inner and not -self._outer <= self._island * d <= self._inwards:
            return None
        heading = self._line.heading_at(s)
        return (here[0] - last[0]) * math.cos(heading) + (here[1] - last[1]) * math.sin(heading)


def _links(network: RoadNetwork, source: str, target: str) -> list[Connection]:
    """The connections between two edges, of the outermost lane first."""
    lanes = network.lanes
    return [c for i in network.edges[source].lanes for c in network.outgoing[i] if lanes[c.to_lane].edge == target]


def _inside(network: RoadNetwork, lanes: tuple[int, ...]) -> list[int]:
    """The lanes by which some lanes lead through the junction at their end."""
    return [v for i in lanes for c in network.outgoing[i] for v in c.via]
