"""Episodes made by hand for tests: a straight road of two lanes each way, and actors on tracks as given."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tsbench.episode.outcome import Contact, EpisodeFacts, EpisodeResult, Outcome
from tsbench.geometry.polyline import Array, Polyline
from tsbench.roads.lane_graph import Destination, LaneGraph
from tsbench.roads.network import Edge, Lane, RoadNetwork
from tsbench.rules.monitor import Verdict, Verdicts, Violation
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.annotations import ALL_LANES, SignInstance
from tsbench.signs.catalog import load_catalog
from tsbench.sim.navigation import Navigator, RouteView
from tsbench.sim.scene import EgoStart, Obstacle, Scene, SceneFile
from tsbench.sim.world import DT_S, ActorKind, Actors, ActorTable, EgoState, WorldSnapshot

LENGTH_M = 500.0
LIMIT_MPS = 60 / 3.6


def road() -> RoadNetwork:
    """Edge `east` (lanes 0 and 1 at y = -4.8 and -1.6) and edge `west` beside it (lanes 2 and 3)."""
    lanes, edges = [], {}
    for base, (edge, side) in enumerate((("east", -1.0), ("west", 1.0))):
        for k, y in enumerate((4.8, 1.6)):
            xs = (0.0, LENGTH_M) if edge == "east" else (LENGTH_M, 0.0)
            i = 2 * base + k
            lanes.append(
                Lane(
                    i, f"{edge}_{k}", edge, k, Polyline([(xs[0], side * y), (xs[1], side * y)]), 3.2,
                    LIMIT_MPS, False, left=-1 if k else i + 1, right=i - 1 if k else -1,
                    length=LENGTH_M, allow=frozenset(), disallow=frozenset(),
                )
            )  # fmt: skip
        edges[edge] = Edge(edge, "a", "b", (2 * base, 2 * base + 1), False, LENGTH_M, priority=1)
    return RoadNetwork(tuple(lanes), {lane.id: lane.index for lane in lanes}, edges, {}, (), tuple(() for _ in lanes))


def sign() -> SignInstance:
    return SignInstance("plate", "3.24", 40.0, "east", ALL_LANES, 100.0, 100.0, -8.0, 0.0, "target")


def scene(obstacles: tuple[Obstacle, ...] = (), destination_m: float = 400.0) -> Scene:
    return Scene(
        net=SceneFile(Path("net.xml"), b""), additional=SceneFile(Path("scene.xml"), b""), network=road(),
        signs=(sign(),), targets=("plate",), obstacles=obstacles, start=EgoStart("east_0", 10.0, 5.0),
        destination=Destination("east", destination_m), convoy=None, horizon=600, seed=7,
        route_hint=("east",), catalog=load_catalog(),
    )  # fmt: skip


def ego(x: float, y: float = -4.8, heading: float = 0.0, speed: float = 0.0, **other: Any) -> EgoState:
    lane = 0 if -6.4 <= y <= -3.2 else 1 if -3.2 < y <= 0 else 3 if 0 < y <= 3.2 else 2 if y <= 6.4 else -1
    values = {
        "acceleration": 0.0,
        "steering": 0.0,
        "yaw_rate": 0.0,
        "lane": lane,
        "s": x,
        "d": 0.0,
        "on_road": lane >= 0,
    }
    return EgoState(x=x, y=y, heading=heading, speed=speed, **{**values, **other})


class Track:
    """One actor: its poses (n, 3), NaN where it is out of sight. Its place along its lane is x + shift."""

    def __init__(
        self, name: str, poses: Array, kind: ActorKind = ActorKind.CAR, size: tuple[float, float] = (4.0, 2.0),
        route: tuple[str, ...] = ("east",), lane: int = -1, shift: float = 0.0,
    ):  # fmt: skip
        self.name, self.poses, self.kind, self.size = name, np.asarray(poses, dtype=np.float64), kind, size
        self.route, self.lane, self.shift = route, lane, shift


def straight(n: int, x: float, y: float, heading: float, speed: float) -> Array:
    """(n, 3) poses of a uniform motion."""
    gone = speed * DT_S * np.arange(n)
    return np.column_stack((x + gone * math.cos(heading), y + gone * math.sin(heading), np.full(n, heading)))


def snapshots(egos: Sequence[EgoState], tracks: Sequence[Track] = ()) -> list[WorldSnapshot]:
    table = ActorTable()
    tracks = sorted(tracks, key=lambda t: t.name)
    for t in tracks:
        table.add(t.name, t.kind, *t.size, t.route)
    out = []
    for k, state in enumerate(egos):
        seen = [i for i, t in enumerate(tracks) if k < len(t.poses) and np.isfinite(t.poses[k, 0])]
        pose = np.array([tracks[i].poses[k] for i in seen]).reshape(-1, 3)
        speeds = []
        for i in seen:
            p = tracks[i].poses
            a, b = (k, k + 1) if k + 1 < len(p) and np.isfinite(p[k + 1, 0]) else (k - 1, k)
            speeds.append(float(np.hypot(*(p[b] - p[a])[:2])) / DT_S if a >= 0 else 0.0)
        index = np.array(seen, dtype=np.int32)
        lanes = np.array([tracks[i].lane for i in seen], dtype=np.int32)
        along = pose[:, 0] + np.array([tracks[i].shift for i in seen])
        actors = Actors(table, index, pose, np.array(speeds), lanes, along)
        out.append(WorldSnapshot(k, k * DT_S, state, actors))
    return out


def violation(start_s: float = 3.1, **other: Any) -> Violation:
    values: dict[str, Any] = {
        "rule": "speed", "clause": "over_limit", "sign_id": "plate", "sign_code": "3.24", "start_s": start_s,
        "end_s": start_s + 2.0, "x": 120.0, "y": -4.8, "heading": 0.0, "speed": 15.0, "value": 54.1,
        "threshold": 41.0, "margin": 13.1, "unit": "km/h", "other": None,
        "sentence": "The ego drove up to 54.1 km/h.",
    }  # fmt: skip
    return Violation(**{**values, **other})


def verdict(*violations: Violation, engaged: bool = True, steps: int = 0) -> Verdict:
    return Verdict("plate", engaged, violations, steps)


def facts(
    egos: Sequence[EgoState],
    tracks: Sequence[Track] = (),
    *,
    outcome: Outcome = Outcome.TIMEOUT,
    contact: Contact | None = None,
    target: Verdict | None = None,
    others: tuple[Verdict, ...] = (),
    needless: tuple[Violation, ...] = (),
    wrong_way: tuple[Violation, ...] = (),
    world: Scene | None = None,
) -> EpisodeFacts:
    world = world or scene()
    navigator = Navigator(LaneGraph(world.network), world.destination)
    views: list[RouteView] = [navigator.update(e) for e in egos]
    return EpisodeFacts(
        scene=world, snapshots=snapshots(egos, tracks), route=views[-1], start_remaining_m=views[0].remaining,
        outcome=outcome, contact=contact,
        verdicts=Verdicts((target or verdict(),), others, needless, wrong_way),
    )  # fmt: skip


def spec(scenario_id: str = "speed_limit-000-0") -> ScenarioSpec:
    return ScenarioSpec(
        scenario_id=scenario_id, scenario_type="speed_limit", group="speed", sign_code="3.24",
        sign_value=40.0, map_id="corridor-1", family="corridor", shape="straight", slot="", variant=0,
        split="test", seed=7, initial_speed=5.0, route_length=float("nan"), density=0.1,
        drivers=2, layout=0, horizon=600, net="nets/corridor-1.net.xml.gz", additional="scenes/a.xml.gz",
        net_sha256="0" * 64,
        additional_sha256="1" * 64,
    )  # fmt: skip


def result(episode: EpisodeFacts | None, planner: str = "idm", **other: Any) -> EpisodeResult:
    n = len(episode.snapshots) - 1 if episode else 0
    values: dict[str, Any] = {
        "spec": spec(), "planner": planner, "outcome": episode.outcome if episode else Outcome.SIM_ERROR,
        "error": "", "detail": "", "facts": episode, "commands": np.arange(2.0 * n).reshape(n, 2) / 7,
        "planner_s": np.zeros(n), "start_s": 0.0, "sim_s": 0.0, "total_s": 0.0,
    }  # fmt: skip
    return EpisodeResult(**{**values, **other})


def same_snapshots(a: Sequence[WorldSnapshot], b: Sequence[WorldSnapshot]) -> None:
    """Assert that two records of an episode are equal, bit for bit."""
    assert len(a) == len(b)
    for p, q in zip(a, b, strict=True):
        assert (p.step, p.time, p.ego) == (q.step, q.time, q.ego)
        for name in ("index", "pose", "speed", "lane", "lane_s"):
            left, right = getattr(p.actors, name), getattr(q.actors, name)
            assert left.dtype == right.dtype
            assert left.shape == right.shape
            assert left.tobytes() == right.tobytes(), name
        t, u = p.actors.table, q.actors.table
        n = len(t.ids)
        assert (t.ids, t.routes, t.rows) == (u.ids, u.routes, u.rows)
        assert np.array_equal(t.kind[:n], u.kind[:n])
        assert t.length[:n].tobytes() == u.length[:n].tobytes()
        assert t.width[:n].tobytes() == u.width[:n].tobytes()
