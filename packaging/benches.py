"""What parts of the harness cost on this machine, as JSON; `tsbench bench` measures the whole.

python packaging/benches.py fresh | isolation [--planner PLANNER]... | networks | env
"""

from __future__ import annotations

import json
import mmap
import os
import statistics
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import click
import gymnasium
import numpy as np

from tsbench.board.isolation.isolated_loading import describe, load
from tsbench.cli.network_arithmetic import NETWORKS, batched, questions
from tsbench.episode.runner import EpisodeRunner
from tsbench.learn.envs import DRIVE
from tsbench.learn.envs.drive_env import drive_in_processes
from tsbench.planners.base import Infer, Records
from tsbench.planners.planner_spec import PlannerSpec
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.run.check_planner import choose
from tsbench.run.execution.fresh_episode import run_in_child
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation

BLOCK = 500
ONWARD = (0.05, 0.0)
# Environments at once, and steps of each before time is taken: what only the first steps need has been made by then.
_SEVERAL, _FIRST = 2, 20
_ROUNDS, _BATCH = 30, 8
_WHOLE, _SCENES, _WHOLE_ROUNDS = "plant2-ft", 4, 3


def fresh(planner: str, scenes: int, rounds: int) -> dict[str, float]:
    """Processor time of an episode, ms: medians over rounds of the mean over scenes of dev, played by the worker and in
    its children. Goal: at most 15 ms more. Children come first: a worker that forks has played nothing itself.
    """
    rows = sorted(choose(DataSet().table("dev"), scenes), key=lambda row: row.net)
    runner = EpisodeRunner(resolve(planner))
    for row in rows:
        runner.prepare(row)

    # Children leave no accounts: each adds its own processor time here, its end not included.
    spent = np.frombuffer(mmap.mmap(-1, 8), dtype=np.float64)

    def drive(row: ScenarioSpec) -> None:
        runner.run(row)
        spent[0] += time.process_time()

    def in_children() -> float:
        before, spent[0] = time.process_time(), 0.0
        for row in rows:
            status = run_in_child(partial(drive, row))
            if status is not None:
                raise RuntimeError(f"{row.scenario_id}: the child ended with {status}")
        return time.process_time() - before + float(spent[0])

    def together() -> float:
        before = time.process_time()
        for row in rows:
            runner.run(row)
        return time.process_time() - before

    with closing(runner):
        found = [
            statistics.median(1000.0 * play() / len(rows) for _ in range(rounds)) for play in (in_children, together)
        ]
    return {"together_ms": found[1], "in_child_ms": found[0]}


def isolation(planner: str, scenes: int, rounds: int) -> dict[str, float | None]:
    """Median times of a planner's answer by the clock, µs: of the best of the rounds, as others use the machine, too.

    together: in the referee's process; None for a program. isolated: on the referee's processor, as where workers use
    all of them (goal: at most 150 more). apart: on any processor, which may have to be woken up for each answer.
    """
    rows = choose(DataSet().table("dev"), scenes)
    loader = SceneLoader(DataSet())
    with closing(Simulation()) as simulation:

        def took(runner: EpisodeRunner) -> float:
            return 1e6 * float(np.median(np.concatenate([runner.run(row).planner_s for row in rows])))

        def runner_of(planner: LoadedPlanner) -> EpisodeRunner:
            return EpisodeRunner(planner, simulation=simulation, loader=loader)

        here = None if PlannerSpec.parse(planner).isolated_only else runner_of(resolve(planner))
        info = describe(planner).planner
        beside, free = runner_of(load(info, show=True)), runner_of(load(info, show=True))
        together, isolated, apart = [], [], []
        for _ in range(rounds):
            if here is not None:
                together.append(took(here))
            # Where the planner's process is started is where it stays.
            with _one_processor():
                isolated.append(took(beside))
            apart.append(took(free))
    return {"together_us": min(together, default=None), "isolated_us": min(isolated), "apart_us": min(apart)}


@contextmanager
def _one_processor() -> Iterator[None]:
    """This process, and what it starts, on the first of its processors."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def network(name: str) -> dict[str, float]:
    """CPU ms for one answer alone, and for each of eight; the least over many rounds, as others disturb."""
    infer = batched(name).network("cpu")
    asked = np.resize(questions(name), _BATCH)
    return {"alone_ms": _least(infer, asked[:1]), "of_eight_ms": _least(infer, asked) / _BATCH}


def _least(infer: Infer, asked: Records) -> float:
    took = []
    for _ in range(_ROUNDS):
        began = time.process_time()
        infer(asked)
        took.append(time.process_time() - began)
    return 1000.0 * min(took)


def whole() -> float:
    """CPU ms of a tick of plant2-ft's whole episodes on scenes of the dev split: the least of a few rounds."""
    rows = choose(DataSet().table("dev"), _SCENES)
    took = []
    with closing(EpisodeRunner(resolve(_WHOLE))) as runner:
        for _ in range(_WHOLE_ROUNDS):
            began = time.process_time()
            ticks = sum(len(runner.run(row).commands) for row in rows)
            took.append(1000.0 * (time.process_time() - began) / ticks)
    return min(took)


def environment(observation: str, steps: int) -> dict[str, float]:
    """Steps of the Gymnasium environment per second of CPU time: of the median block, over all with the starts of
    episodes, and of two in `AsyncVectorEnv`. Episodes are of the test split, and the ego follows its route.
    """
    env = gymnasium.make(DRIVE, split="test", observation=observation, action="aim")
    action = np.array(ONWARD, dtype=np.float32)
    env.reset(seed=0)
    blocks, starts = [], 0.0
    for _ in range(max(steps // BLOCK, 1)):
        spent = 0.0
        for _ in range(BLOCK):
            began = time.process_time()
            _, _, terminated, truncated, _ = env.step(action)
            spent += time.process_time() - began
            if terminated or truncated:
                began = time.process_time()
                env.reset()
                starts += time.process_time() - began
        blocks.append(spent)
    env.close()
    return {
        "steps_per_s": BLOCK / statistics.median(blocks),
        "with_starts": len(blocks) * BLOCK / (sum(blocks) + starts),
        "vectorised": _vectorised(observation, steps),
    }


def _vectorised(observation: str, steps: int) -> float:
    """This process's time and that of the environments together. Starts of episodes and the way from process to process
    count.
    """
    envs = drive_in_processes(_SEVERAL, split="test", observation=observation, action="aim")
    action = np.tile(np.array(ONWARD, dtype=np.float32), (_SEVERAL, 1))
    envs.reset(seed=0)
    for _ in range(_FIRST):
        envs.step(action)
    pids = [process.pid for process in envs.processes]
    began, each = _cpu_seconds(pids), max(steps // _SEVERAL, 1)
    for _ in range(each):
        envs.step(action)
    spent = _cpu_seconds(pids) - began
    envs.close()
    return each * _SEVERAL / spent


def _cpu_seconds(pids: Iterable[int | None]) -> float:
    """CPU time of this process and of others, which Linux counts in hundredths of a second."""
    ticks = 0
    for pid in pids:
        # Behind the name, which may hold anything and ends with the last bracket: user and system time.
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        ticks += int(fields[11]) + int(fields[12])
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")


@click.command()
@click.argument("part", type=click.Choice(["fresh", "isolation", "networks", "env"]))
@click.option("--planner", "planners", multiple=True, help="With isolation (default: idm and idm-e).")
@click.option("--limit", default=12, show_default=True, help="How many scenes.")
@click.option("--rounds", default=5, show_default=True)
def main(part: str, planners: Sequence[str], limit: int, rounds: int) -> None:
    """An episode in a child of its worker, a planner in a process of its own, networks' answers, or the environment."""
    found: dict[str, Any] = {}
    if part == "fresh":
        found["blind"] = fresh("blind", limit, rounds)
    elif part == "isolation":
        found = {name: isolation(name, limit, rounds) for name in planners or ("idm", "idm-e")}
    elif part == "networks":
        found = {name: network(name) for name in NETWORKS}
        found[_WHOLE]["tick_ms"] = whole()
    else:
        found = {kind: environment(kind, rounds * BLOCK) for kind in ("vector", "scene")}
    click.echo(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
