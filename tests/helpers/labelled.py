"""Labelled cases: a scripted ego and scripted traffic on a small net, with the expected verdict inside.

A case (`tests/cases/<rule>/<case>.yaml`):
    what: one sentence.
    shows: inside (just within what is allowed), outside (just beyond it) or elsewhere (another lane, arm or
        direction); each type has one of each.
    net: name of a net under tests/cases/nets.
    mirrored: code of the target's plate in the mirror image, where that is another one.
    signs: plates, the target first: code, edge, position_m; as needed value, lane, role, ends, params,
        temporary.
    contrast: of `needless_*`, where the target binds nobody: the clause that the folder is named after, its params.
    targets: how many of the signs are; as needed.
    watches: `wrong_way` where the monitor of all scenes is meant, and not the target's or the clause's.
    obstacles: id, lane, s (centre, m along the lane), length, width; as needed d (m left), turn (deg).
    ego, actors: path (ordinary lanes in order; those inside junctions are filled in) or points ([x, y] in
        order), start (m along it: the ego's centre, another's front), speed ([seconds, m/s] phases, or [seconds,
        m/s, m/s] where it changes evenly; the ego's are the length of the case, another keeps its last).
        Actors: id; as needed kind, length, width, route. Pedestrians go by points: they are on no lane.
    expect: engaged; events: clause, at (s), until where the clause lasts, value (to 0.01, or to `tolerance`),
        threshold, other; steps where they are not all those of the events; completes, when (s) the rule takes the
        episode for complete (null: never).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from transform import Transform

from tsbench.geometry.polyline import Polyline, join
from tsbench.roads.lane_graph import Destination
from tsbench.roads.localization import LaneLocator
from tsbench.roads.network import RoadNetwork, read_network
from tsbench.rules.monitor import Verdict
from tsbench.rules.monitors import make_monitors
from tsbench.signs.annotations import ALL_LANES, SignInstance, plate_params
from tsbench.signs.catalog import load_catalog
from tsbench.signs.contrast import CLAUSES, ContrastClause
from tsbench.signs.rule_kinds import read_params
from tsbench.sim.scene import EgoStart, Obstacle, Scene, SceneFile
from tsbench.sim.world import DT_S, ActorKind, Actors, ActorTable, EgoState, WorldSnapshot

# Length and width of who says none, m.
SIZES = {ActorKind.PEDESTRIAN: (0.3, 0.5)}
HERE = Transform()
CASES = Path(__file__).resolve().parent.parent / "cases"
Spec = dict[str, Any]


@cache
def network(name: str) -> RoadNetwork:
    """A shared net."""
    return read_network(CASES / "nets" / f"{name}.net.xml")


def case_files() -> list[Path]:
    """All cases, in the order of their names."""
    return sorted(p for p in CASES.glob("*/*.yaml"))


def read_case(path: Path) -> Spec:
    """A case as plain data."""
    spec: Spec = yaml.safe_load(path.read_text(encoding="utf-8"))
    return spec


@dataclass(frozen=True)
class Track:
    """A scripted mover: a line, and where on it the mover is. lanes: [lane, start on the line] in order."""

    line: Polyline
    lanes: tuple[tuple[int, float], ...]
    start: float
    phases: tuple[tuple[float, float, float], ...]

    def at(self, time: float) -> tuple[float, float]:
        """(arc length, speed) at a time."""
        s, left = self.start, time
        for seconds, first, last in self.phases:
            if left < seconds - 1e-9:
                speed = first + (last - first) * left / seconds
                return s + left * (first + speed) / 2, speed
            s, left = s + seconds * (first + last) / 2, left - seconds
        speed = self.phases[-1][2]
        return s + left * speed, speed

    def lane_at(self, s: float, net: RoadNetwork) -> tuple[int, float]:
        """Lane and SUMO's place on it of a point of the line; -1 for who keeps to no lanes."""
        if not self.lanes:
            return -1, 0.0
        lane, begin = next((x for x in reversed(self.lanes) if x[1] <= s), self.lanes[0])
        one = net.lanes[lane]
        return lane, (s - begin) * one.length / one.line.length


def _track(spec: Spec, net: RoadNetwork) -> Track:
    phases = tuple((float(t), float(v), float(w[0] if w else v)) for t, v, *w in spec["speed"])
    if "points" in spec:
        return Track(Polyline(spec["points"]), (), float(spec["start"]), phases)
    ids = [net.lane_index[name] for name in spec["path"]]
    chain = [ids[0]]
    for a, b in pairwise(ids):
        link = next(c for c in net.outgoing[a] if c.to_lane == b)
        chain += [*link.via, b]
    starts = np.concatenate(([0.0], np.cumsum([net.lanes[i].line.length for i in chain])))
    lanes = tuple((i, float(s)) for i, s in zip(chain, starts, strict=False))
    return Track(join([net.lanes[i].line for i in chain]), lanes, float(spec["start"]), phases)


def _route(spec: Spec, net: RoadNetwork) -> tuple[str, ...]:
    if "route" in spec or "points" in spec:
        return tuple(spec.get("route", ()))
    return tuple(dict.fromkeys(net.lane(name).edge for name in spec["path"]))


def _sign(spec: Spec, number: int, net: RoadNetwork, binds: bool) -> SignInstance:
    lane = net.edge_lanes(spec["edge"])[0]
    x, y = lane.line.point_at(spec["position_m"], -3.0)
    role = spec.get("role", "context" if number else "target")
    params = {k: str(v) for k, v in spec.get("params", {}).items()}
    rule = load_catalog().sign(spec["code"]).rule.name
    return SignInstance(
        id=spec.get("id", f"sign{number}"), code=spec["code"], value=spec.get("value"), edge=spec["edge"],
        lane=spec.get("lane", ALL_LANES), position_m=float(spec["position_m"]), x=x, y=y,
        heading=lane.line.heading_at(spec["position_m"]),
        role=role, ends=spec.get("ends"),
        params=plate_params(rule, params, binds=role == "target" and binds), temporary=spec.get("temporary", False),
    )  # fmt: skip


def _obstacle(spec: Spec, net: RoadNetwork) -> Obstacle:
    line = net.lane(spec["lane"]).line
    x, y = line.point_at(spec["s"], spec.get("d", 0.0))
    heading = line.heading_at(spec["s"]) + np.radians(spec.get("turn", 0.0))
    return Obstacle(spec["id"], "cones", x, y, heading, spec["length"], spec["width"], spec["lane"])


def scene_of(case: Spec, view: Transform) -> Scene:
    """The case's scene as seen through a transform."""
    net = network(case["net"])
    clauses = tuple(
        ContrastClause(name, read_params(CLAUSES[name], {k: str(v) for k, v in params.items()}))
        for name, params in case.get("contrast", {}).items()
    )
    signs = [_sign(s, k, net, not clauses) for k, s in enumerate(case["signs"])]
    if view.mirror and "mirrored" in case:
        signs[0] = replace(signs[0], code=case["mirrored"])
    return Scene(
        net=SceneFile(Path("case.net.xml"), b""), additional=SceneFile(Path("case.add.xml"), b""),
        network=view.network(net), signs=tuple(view.sign(s) for s in signs),
        targets=tuple(sign.id for sign in signs[: case.get("targets", 1)]),
        obstacles=tuple(view.obstacle(_obstacle(o, net)) for o in case.get("obstacles", [])),
        start=EgoStart(net.lanes[0].id, 0.0, 0.0), destination=Destination(net.lanes[0].edge, 0.0),
        convoy=None, horizon=600, seed=0, contrast=clauses, catalog=load_catalog(),
    )  # fmt: skip


def snapshots(case: Spec, view: Transform, seen: RoadNetwork) -> list[WorldSnapshot]:
    """The case's ticks as seen through a transform."""
    net, locator, last = network(case["net"]), LaneLocator(seen), -1
    ego = _track(case["ego"], net)
    others = [(a, _track(a, net)) for a in sorted(case.get("actors", []), key=lambda a: str(a["id"]))]
    table = ActorTable(4)
    for spec, _ in others:
        kind = ActorKind[spec.get("kind", "car").upper()]
        length, width = SIZES.get(kind, (4.5, 1.8))
        table.add(spec["id"], kind, spec.get("length", length), spec.get("width", width), _route(spec, net))
    ticks = []
    for step in range(round(sum(seconds for seconds, *_ in ego.phases) / DT_S) + 1):
        time = step * DT_S
        s, speed = ego.at(time)
        x, y, heading = view.pose(*ego.line.point_at(s), ego.line.heading_at(s))
        last, lane_s, lane_d, on_road = locator.locate(x, y, heading, last)
        state = EgoState(x, y, heading, speed, 0.0, 0.0, 0.0, last, lane_s, lane_d, on_road)
        ticks.append(WorldSnapshot(step, time, state, _actors(table, others, time, net, view)))
    return ticks


def _actors(
    table: ActorTable, others: list[tuple[Spec, Track]], time: float, net: RoadNetwork, view: Transform
) -> Actors:
    poses, speeds, lanes, places = [], [], [], []
    for row, (_, track) in enumerate(others):
        s, speed = track.at(time)
        middle = s - table.length[row] / 2
        poses.append(view.pose(*track.line.point_at(middle), track.line.heading_at(middle)))
        lane, place = track.lane_at(s, net)
        speeds.append(speed)
        lanes.append(lane)
        places.append(place)
    return Actors(
        table, np.arange(len(others), dtype=np.int32), np.array(poses, dtype=np.float64).reshape(-1, 3),
        np.array(speeds, dtype=np.float64), np.array(lanes, dtype=np.int32),
        np.array(places, dtype=np.float64),
    )  # fmt: skip


@dataclass(frozen=True)
class Play:
    """A case as it is played: the scene, and the ticks in order. Nothing in it comes from a rule."""

    case: Spec
    scene: Scene
    ticks: tuple[WorldSnapshot, ...]


# Making a case takes far longer than judging it. Under mutmut all are kept for thousands of mutants: 0.4 GB.
@lru_cache(maxsize=None if "MUTANT_UNDER_TEST" in os.environ else 1)
def play(path: Path, view: Transform = HERE) -> Play:
    """A case as seen through a transform."""
    case = read_case(path)
    scene = scene_of(case, view)
    return Play(case, scene, tuple(snapshots(case, view, scene.network)))


@dataclass(frozen=True)
class Judgement:
    """The verdict on a target, and when its rule took the episode for complete (s; None: never).

    so_far: whether the rule bound the ego, and the clauses that the monitor told at the last tick and after the end.
    """

    verdict: Verdict
    completed_at: float | None
    so_far: tuple[bool, tuple[str, ...], tuple[str, ...]]


def judge(played: Play) -> Judgement:
    """What a case's monitor makes of it. Never kept: a changed rule must show."""
    monitors = make_monitors(played.scene)
    monitor = monitors.needless[0] if monitors.needless else monitors.targets[0]
    if "watches" in played.case:
        monitor = getattr(monitors, played.case["watches"])
    completed_at = None
    for tick in played.ticks:
        monitor.update(tick)
        if completed_at is None and monitor.completed:
            completed_at = tick.time
    before, verdict = monitor.clauses(), monitor.finish()
    return Judgement(verdict, completed_at, (monitor.engaged, before, monitor.clauses()))
