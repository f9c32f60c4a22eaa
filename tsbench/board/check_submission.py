"""What `tsbench submit` would refuse, said before hours are spent: a planner in its sandbox, and scenes of dev.

Nothing of the planner's code runs in this process.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import pairwise

import numpy as np

from tsbench.board.isolation.isolated_loading import describe, load
from tsbench.core.errors import InputError
from tsbench.core.text import fault_in_name
from tsbench.episode.outcome import EpisodeResult
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.check import Finding, Level
from tsbench.planners.registry import comes_with_tsbench
from tsbench.run import opened_files
from tsbench.run.check_planner import choose, of_results
from tsbench.run.edition import LOCAL, SCORING, contract_now, edition_here, standing_contract
from tsbench.run.planner_info import PlannerInfo
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation

# Files named in a line.
_SHOWN = 5


def check_submission(spec: str, count: int, split: str, on_progress: Callable[[str], None]) -> list[Finding]:
    """Findings. split: that a submission would be of."""
    data = DataSet()
    on_progress("starting the planner in its sandbox")
    found, info = standing(spec, split)
    if info is None:
        return found
    scenes = choose(data.table("dev"), count)
    simulation, loader = Simulation(), SceneLoader(data)
    with closing(simulation):

        def drive(rows: Sequence[ScenarioSpec]) -> list[EpisodeResult]:
            runner = EpisodeRunner(load(info, show=True), simulation=simulation, loader=loader)
            results = []
            for number, row in enumerate(rows, start=1):
                on_progress(f"scene {number} of {len(rows)}")
                results.append(runner.run(row))
            return results

        results = drive([*scenes, scenes[0]])
        found.append(_repeats([results[0], results[-1], *drive(scenes[:1])]))
    return [*found, *of_results(results[:-1], spec)]


def standing(spec: str, split: str) -> tuple[list[Finding], PlannerInfo | None]:
    """What can be said before it drives, and what it is; None where it does not come up."""
    found = [_contract(split)]
    try:
        probed = describe(spec)
    except InputError as problem:
        return [*found, Finding(Level.PROBLEM, "start", str(problem))], None
    found.append(Finding(Level.OK, "isolation", f"comes up in a sandbox ({probed.effects['namespaces']})"))
    return [*found, *_about(probed.planner)], probed.planner


def _contract(split: str) -> Finding:
    contract = standing_contract(contract_now(DataSet(), split))
    name = edition_here(contract, DataSet())
    if name.endswith(LOCAL):
        text = f"edition {name}: code or data were changed since the release: submit refuses what is driven with it"
        return Finding(Level.PROBLEM, "contract", text)
    return Finding(Level.OK, "contract", f"{name} ({split}), contract {contract[:12]}")


def _about(info: PlannerInfo) -> list[Finding]:
    if fault := fault_in_name(info.name):
        return [Finding(Level.PROBLEM, "name", fault)]
    weights = f", weights {info.weights_sha256[:12]}" if info.weights_sha256 else ""
    if comes_with_tsbench(info.spec):
        found = [Finding(Level.OK, "code", f"{info.name}, of tsbench, scoring {SCORING}{weights}")]
    elif not info.files:
        return [Finding(Level.PROBLEM, "code", "its code is in no file that could be hashed: write it to one")]
    else:
        shown, more = opened_files.names(info.files)[:_SHOWN], len(info.files) - _SHOWN
        others = f" and {more} more" if more > 0 else ""
        found = [Finding(Level.OK, "code", f"{info.name}, hashed: {', '.join(shown)}{others}{weights}")]
    if info.privileged:
        found.append(Finding(Level.NOTE, "privilege", "is told the target's rule: the row is flagged as privileged"))
    if info.may_remember:
        text = "its episodes share a process: the row is marked as one that may remember earlier episodes"
        found.append(Finding(Level.NOTE, "memory", text))
    return found


def _repeats(same: Sequence[EpisodeResult]) -> Finding:
    """Of one scene: at first, after others, and by a new process."""
    if any(not np.array_equal(a.commands, b.commands) for a, b in pairwise(same)):
        text = "other commands on the same scene the second time: a verification of the row will refute it"
        return Finding(Level.PROBLEM, "determinism", text)
    return Finding(Level.OK, "determinism", "same scene, same commands: after other scenes, and in a new process")
