"""Departures that keep the asked density of a scene: found by driving the scene once without the ego.

While SUMO runs, a car is let in wherever there is room as soon as there are fewer cars than asked; what was let in is
written down and becomes the scene's departures. What is missing from the mean of the first 30 s (the ego's and the
convoy's surroundings start empty) is made up for within them. Units: s, m.
"""

from __future__ import annotations

import numpy as np

from tsbench.make.scenes.traffic import Car, Router, TrafficRequest, driving_lanes, make_car
from tsbench.roads.lane_graph import LaneGraph, Turn
from tsbench.roads.network import Lane, RoadNetwork
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

DENSITY_WINDOW_S = 30.0
MOST_EXCESS = 1.5
LEAST_EXCESS = 0.6
CORRECT_WITHIN_S = 8.0
CYCLE_S = 30.0
GREEN_S = 15.0
ENTER_AFTER_EGO_S = 4.0
LEAST_HEADWAY_S = 1.5
LEAST_ROOM_M = 11.0
SHORTEST_LANE_M = 15.0
EVERY_TICKS = 4
# A car that stands for longer, so near its line or within a junction, never gets its turn.
LONGEST_STAND_S = 30.0
AT_LINE_M = 10.0
STANDING_M = 0.5
OWN_PREFIX = "bg_"


class DemandCalibration:
    """Lets cars into a running simulation; `cars` is what was let in, in order.

    jammed: turns that a car waited for in vain, first at its line.
    """

    def __init__(
        self,
        sim: Simulation,
        network: RoadNetwork,
        graph: LaneGraph,
        ask: TrafficRequest,
        present: list[Car],
        target: float,
        rng: np.random.Generator,
    ) -> None:
        self.sim, self.network, self.graph, self.ask, self.rng = sim, network, graph, ask, rng
        self.cars = list(present)
        self.first_new = len(present)
        self.target = target
        self.router = Router(graph, ask.avoid_turns)
        entered = {c.to_lane for c in network.connections}
        lanes = driving_lanes(network, ask.closed_edges)
        self.entries = [i for i in lanes if i.index not in entered and i.line.length >= SHORTEST_LANE_M]
        # The lane that has waited longest is next; the first order is drawn.
        order = rng.permutation(len(self.entries))
        self.last = {lane.id: -100.0 + float(order[k]) for k, lane in enumerate(self.entries)}
        self.jammed: set[Turn] = set()
        # By car: its last ordinary edge, the lane and the place where it was seen first, and when.
        self._stands: dict[str, tuple[str, str, float, float]] = {}
        self.phase = float(rng.uniform(0.0, CYCLE_S))
        self.ego_edge = network.lane(ask.start.lane).edge

    def drive(self, duration_s: float) -> float:
        """Run the loaded scene; returns the mean number of cars on ordinary lanes over 30 s, once some may enter."""
        total, samples = 0, 0
        window = int(DENSITY_WINDOW_S / DT_S / EVERY_TICKS)
        for tick in range(int(duration_s / DT_S)):
            self.sim.step()
            if tick % EVERY_TICKS or tick * DT_S < self.ask.quiet_s:
                continue
            count, rear = self._fleet_now(tick * DT_S)
            wanted = self.target
            if samples < window:
                total, samples = total + count, samples + 1
                missing = self.target * samples - total
                wanted += missing / max(window - samples, CORRECT_WITHIN_S / DT_S / EVERY_TICKS)
            wanted = min(max(wanted, LEAST_EXCESS * self.target), MOST_EXCESS * self.target)
            self._let_in(round(tick * DT_S, 1), count, wanted, rear)
        return total / max(samples, 1)

    def _fleet_now(self, now: float) -> tuple[int, dict[str, float]]:
        """Background cars on ordinary lanes, and how far the last one on each lane has come."""
        count = 0
        rear: dict[str, float] = {}
        for name, lane, place in self.sim.fleet():
            if name.startswith(OWN_PREFIX):
                count += lane[0] != ":"
                rear[lane] = min(rear.get(lane, place), place)
                self._watch(name, lane, place, now)
        return count, rear

    def _watch(self, name: str, lane: str, place: float, now: float) -> None:
        """Note the turn of a car that stands at its line, or in a junction, for too long."""
        edge, before, since, at = self._stands.get(name, ("", "", 0.0, -1.0))
        if lane != before or place - since > STANDING_M:
            edge = edge if lane[0] == ":" else self.network.lane(lane).edge
            self._stands[name] = (edge, lane, place, now)
        elif now - at > LONGEST_STAND_S:
            left = self.network.lane(lane).line.length - place
            route = next(car.edges for car in self.cars if car.id == name)
            if edge in route[:-1] and (lane[0] == ":" or left < AT_LINE_M):
                self.jammed.add((edge, route[route.index(edge) + 1]))

    def _let_in(self, now: float, count: int, wanted: float, rear: dict[str, float]) -> None:
        red = (now + self.phase) % CYCLE_S > GREEN_S
        for lane in sorted(self.entries, key=lambda i: (self.last[i.id], i.index)):
            # Half a car: the next one would bring the mean as far above what is wanted as it is below it now.
            if count + 0.5 > wanted:
                return
            if now - self.last[lane.id] < LEAST_HEADWAY_S or rear.get(lane.id, 1e9) < LEAST_ROOM_M:
                continue
            if lane.edge == self.ego_edge and now < ENTER_AFTER_EGO_S:
                continue
            if red and lane.edge in self.ask.platoons:
                continue
            self._enter(now, lane)
            count += 1

    def _enter(self, now: float, lane: Lane) -> None:
        edges = self.router.walk(lane.edge, self.rng)
        car = make_car(self.cars, self.rng, round(now + DT_S, 1), edges, lane, None, self.ask, self.graph)
        self.sim.add_car(car.id, f"bg{car.driver}", car.edges, car.lane)
        self.cars.append(car)
        # A little unevenness, or all entries would beat in time.
        self.last[lane.id] = now + float(self.rng.uniform(0.0, 1.5))
