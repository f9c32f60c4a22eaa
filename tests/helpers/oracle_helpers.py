"""What tests of the oracle's collections share: experts, lines of a journal, and a collection of three scenarios."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import numpy as np

from tsbench.learn.oracle.runner import FIGURES, pack
from tsbench.learn.oracle.store import KIND, Collection, basis
from tsbench.run.log.manifest import new_manifest
from tsbench.run.log.record import Record, Row
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.spec import ScenarioSpec

PLANNERS = [
    PlannerInfo("idm-e", "idm-e", True, True, (), None, "c"),
    PlannerInfo("idm-s4-e", "idm-s4-e", True, True, (), None, "c"),
    PlannerInfo("net-e", "net-e", True, True, (), "w", "c"),
]


def collection(
    folder: Path, table: list[ScenarioSpec], planners: list[PlannerInfo] = PLANNERS, redrive: bool = False
) -> Collection:
    effective = {"collection": KIND, "split": "train", "tries": 4}
    manifest = new_manifest(basis(), {}, effective, planners)
    return Collection(folder, manifest, table, planners, redrive)


def line(planner: str, spec: ScenarioSpec, *steps: int, comfort: float = 0.5) -> Record:
    """Tries of an expert on a scenario; the last one succeeded, unless it took 0 steps."""
    tries: list[Row] = []
    for number, count in enumerate(steps):
        last = number == len(steps) - 1 and count > 0
        figures: Row = dict.fromkeys(FIGURES) | {"compliant": last, "engaged": True, "mean_speed": 5.0}
        figures |= {"steps": count, "comfort": comfort, "ego": f"{count:016x}", "others": f"{number:016x}"}
        outcome = "arrived" if last else "timeout"
        tries.append({"attempt": number, "outcome": outcome, "error": None, "scd": last, **figures})
    done = tries[-1]["scd"]
    row = {
        "planner": planner, "scenario_id": spec.scenario_id, "outcome": tries[-1]["outcome"], "error": None,
        "scd": done, "tries": tries,
        "commands": pack(np.full((steps[-1], 2), len(planner), dtype=np.int16)) if done else None,
        "intents": [[3, ["a", "b"]], [7, []]] if done else None,
    }  # fmt: skip
    return Record(row, [], {}, "")


def three_scenarios(folder: Path, rows: list[ScenarioSpec]) -> Path:
    """Three scenarios: two experts of the IDM kind and a network; the network's own; nobody's."""
    table = rows[:3]
    with closing(collection(folder / "c", table)) as made:
        for record in (
            line("net-e", table[0], 100, comfort=0.9), line("idm-e", table[0], 120, comfort=0.9),
            line("idm-s4-e", table[0], 0, 90, comfort=0.8), line("net-e", table[1], 200), line("idm-e", table[1], 0),
            line("idm-s4-e", table[1], 0, 0), line("idm-e", table[2], 0), line("idm-s4-e", table[2], 0, 0),
            line("net-e", table[2], 0),
        ):  # fmt: skip
            made.keep(record)
        made.end(complete=True)
    return folder
