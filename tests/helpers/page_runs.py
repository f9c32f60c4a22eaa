"""A run with traces for the tests of pages: 48 episodes, four of which can be played."""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import episode_builders as made
import numpy as np
import run_builders

from tsbench.episode.outcome import EpisodeFacts, Outcome
from tsbench.episode.trace import trace_path, write_trace
from tsbench.report.page.episode_player import EpisodePacker
from tsbench.roads.lane_graph import LaneGraph
from tsbench.rules.monitor import Verdicts
from tsbench.scenarios.data_set import DataSet

HOSTILE = '<img src=x onerror="document.title=1">&amp;.py:Mine'
SENTENCE = "The ego drove <b>54.1 km/h</b> beside convoy_0 & more."
PLANNERS = ("idm", HOSTILE)
TRACED = ("speed_limit-m0-v0", "speed_limit-m1-v0")


def an_episode(violated: bool = True, ticks: int = 61) -> EpisodeFacts:
    """6 s: the ego drives at 10 m/s, a car comes towards it, a bus that turns left is out of sight for a second."""
    egos = [made.ego(60.0 + k, speed=10.0) for k in range(ticks)]
    bus = made.straight(ticks, 80.0, -1.6, 0.0, 8.0)
    bus[20:30] = np.nan
    others = [
        made.Track("car", made.straight(ticks, 125.0, 1.6, math.pi, 5.0)),
        made.Track("convoy_0", bus, made.ActorKind.BUS, (12.0, 2.5), ("east", "west"), lane=1, shift=400.0),
        made.Track("walker", made.straight(ticks, 110.0, -8.0, 0.0, 1.0), made.ActorKind.PEDESTRIAN, (0.4, 0.4)),
    ]
    event = made.violation(3.0, x=90.0, y=-4.8, sentence=SENTENCE)
    target = made.verdict(event) if violated else made.verdict()
    return made.facts(egos, others, outcome=Outcome.ARRIVED, target=target)


def put_trace(run: Path, planner: str, scenario: str, facts: EpisodeFacts | None = None, **other: Any) -> Path:
    """Write a trace; the record says what it says. facts: other than an_episode; other: of its result."""
    spec = replace(made.spec(scenario), map_id="map-1-0")
    path = trace_path(run, planner, scenario)
    write_trace(path, made.result(facts or an_episode(), planner, spec=spec, **other))
    return path


def make_run(folder: Path, planners: tuple[str, ...] = PLANNERS, **other: Any) -> Path:
    """The run: each planner violated the first traced scenario and solved the second."""
    broken = run_builders.lost("over_limit") | {"violations": 1, "violation_time_s": 3.0}
    changes = {"speed_limit_m0_v0": broken, "speed_limit_m1_v0": {"violations": 0}}
    rows = [row for name in planners for row in run_builders.episodes(name, **changes)]
    event = asdict(made.violation(3.0, sentence=SENTENCE))
    events = [{"planner": name, "scenario_id": TRACED[0], "number": 0, "target": True, **event} for name in planners]
    run = run_builders.make_run(folder, rows, events=events, **other)
    for name in planners:
        for scenario in TRACED:
            put_trace(run, name, scenario, an_episode(violated=scenario == TRACED[0]))
    return run


def make_pair_run(folder: Path) -> Path:
    """24 pairs of each of two types by idm, two of them failed: the contrast half of TRACED[0] is needlessly slow, the
    signed half of TRACED[1] is broken, and that alone has a trace there."""
    slow, broken = TRACED[0], TRACED[1]
    changes = {
        f"{slow}-c".replace("-", "_"): run_builders.lost("needless_slow") | {"violations": 1},
        broken.replace("-", "_"): run_builders.lost("over_limit") | {"violations": 1},
    }
    run = run_builders.make_run(folder, run_builders.pairs("idm", **changes))
    event = made.violation(3.0, clause="needless_slow", x=90.0, y=-4.8)
    for scenario, half, facts in (
        (slow, "signed", an_episode(violated=False)),
        (f"{slow}-c", "contrast", replace(an_episode(ticks=91), verdicts=Verdicts((made.verdict(event),)))),
        (broken, "signed", an_episode()),
    ):
        spec = replace(made.spec(scenario), map_id="map-1-0", pair_id=scenario.removesuffix("-c"), half=half)
        write_trace(trace_path(run, "idm", scenario), made.result(facts, "idm", spec=spec))
    return run


class Loader:
    """Every scene is the handmade one."""

    def load(self, spec: object) -> tuple[object, object]:
        scene = made.scene()
        return scene, SimpleNamespace(graph=LaneGraph(scene.network))


def packer(data: DataSet | None = None) -> EpisodePacker:
    return EpisodePacker(data or DataSet(), Loader())
