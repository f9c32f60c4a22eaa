"""How fast the harness is on this machine: three loops over the same scenes, in one run, as ratios.

bare: SUMO alone steps the scene. ego: the ego is placed along its route and the world around it is read. full: the
whole tick with `idm`, monitors and recording. Machines are noisy: the loops take turns, their seconds are the process's
own on the CPU, and only ratios compare. Two workers against one are timed by the clock, on a machine left alone.
Further benches: an episode in a child of its worker (`bench_fresh`), a planner in a process of its own
(`bench_isolation`), and the answers of networks (`bench_networks`).
"""

from __future__ import annotations

import mmap
import multiprocessing
import os
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.synchronize import Barrier
from typing import Final

import numpy as np

from tsbench.board.isolation.isolated_loading import describe, load
from tsbench.cli.network_arithmetic import NETWORKS, batched, questions
from tsbench.episode.outcome import Phase
from tsbench.episode.runner import EpisodeRunner
from tsbench.metrics.episode_metrics import episode_metrics
from tsbench.planners.batching import Infer, Records
from tsbench.planners.planner_spec import PlannerSpec
from tsbench.planners.registry import LoadedPlanner, resolve
from tsbench.run.check_planner import choose
from tsbench.run.execution.fresh_episode import run_in_child
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.ego import Motion, start_motion
from tsbench.sim.navigation import Navigator
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S, EgoState

TICKS = 300
VEHICLES = (10.0, 14.0)


class _Loops:
    """The three loops over one scene; each returns seconds and ticks, those with an ego vehicle-ticks, too."""

    def __init__(self) -> None:
        # One simulation per process: the loops and the runner take turns with it.
        self.runner = EpisodeRunner(resolve("idm"), heartbeat=self._beat)
        self._loop_began = 0.0
        self.sim: Simulation = self.runner.simulation
        self.loader = SceneLoader(DataSet())

    def _beat(self, phase: int) -> None:
        if phase == Phase.LOADING:
            self._loop_began = 0.0
        elif phase == Phase.SCORING and not self._loop_began:
            self._loop_began = time.process_time()

    def bare(self, spec: ScenarioSpec) -> tuple[float, int]:
        scene, _ = self.loader.load(spec)
        self.sim.load_scene(scene)
        began = time.process_time()
        for _ in range(TICKS):
            self.sim.step()
        return time.process_time() - began, TICKS

    def ego(self, spec: ScenarioSpec) -> tuple[float, int, int]:
        """The ego rolls along its path at 5 m/s, placed and read at each tick."""
        scene, roads = self.loader.load(spec)
        lane = scene.network.lane(scene.start.lane)
        motion = replace(start_motion(scene), speed=5.0)
        self.sim.load_scene(scene)
        self.sim.start_ego(motion, lane.edge, lane.order)
        state = EgoState(
            motion.x, motion.y, motion.heading, speed=5.0, acceleration=0.0, steering=0.0, yaw_rate=0.0,
            lane=lane.index, s=scene.start.s, d=0.0, on_road=True,
        )  # fmt: skip
        line = Navigator(roads.graph, scene.destination).update(state).path.line
        # Five metres a second for as long as the path lasts, and 20 m less: the ego stays on the map.
        ticks = min(TICKS, int((line.length - 20.0) / (5.0 * DT_S)))
        poses = [(*line.point_at(0.5 * k), line.heading_at(0.5 * k)) for k in range(ticks)]
        vehicles = 0
        began = time.process_time()
        for px, py, heading in poses:
            self.sim.place_ego(Motion(px, py, heading, 5.0), "", -1)
            self.sim.step()
            actors = self.sim.actors()
            vehicles += len(actors) if actors is not None else 0
        return time.process_time() - began, ticks, vehicles

    def full(self, spec: ScenarioSpec) -> tuple[float, int, int, float]:
        """A whole episode; the time to its first tick apart."""
        began = time.process_time()
        result = self.runner.run(spec)
        if result.facts is None:
            raise RuntimeError(f"{spec.scenario_id}: {result.error}")
        seconds = time.process_time() - self._loop_began
        shots = result.facts.snapshots
        return seconds, len(shots) - 1, sum(len(s.actors) for s in shots), self._loop_began - began


def bench_scenes(limit: int) -> list[ScenarioSpec]:
    """Test rows with traffic, of all types in turn, and about a dozen vehicles around the ego."""
    rows = [s for s in DataSet().table("test") if s.density > 0]
    loops = _Loops()
    chosen: list[ScenarioSpec] = []
    by_type: dict[str, list[ScenarioSpec]] = {}
    for row in rows:
        by_type.setdefault(row.scenario_type, []).append(row)
    queues = [iter(by_type[t]) for t in sorted(by_type)]
    while queues and len(chosen) < limit:
        for queue in list(queues):
            for row in queue:
                _, ticks, vehicles = loops.ego(row)
                if VEHICLES[0] <= vehicles / max(ticks, 1) <= VEHICLES[1]:
                    chosen.append(row)
                    break
            else:
                queues.remove(queue)
    loops.runner.close()
    return chosen[:limit]


def _episodes(specs: Sequence[ScenarioSpec], gate: Barrier, seconds: multiprocessing.Queue[float]) -> None:
    """In a worker process: warm up, wait for the others, then run all episodes."""
    runner = EpisodeRunner(resolve("idm"))
    runner.run(specs[0])
    gate.wait()
    began = time.perf_counter()
    for spec in specs:
        result = runner.run(spec)
        if result.facts is not None:
            episode_metrics(result.facts)
    seconds.put(time.perf_counter() - began)


def _throughput(specs: Sequence[ScenarioSpec], workers: int) -> float:
    """Episodes per second of so many processes, each with all of `specs`."""
    context = multiprocessing.get_context("spawn")
    gate = context.Barrier(workers)
    seconds: multiprocessing.Queue[float] = context.Queue()
    processes = [context.Process(target=_episodes, args=(specs, gate, seconds)) for _ in range(workers)]
    for process in processes:
        process.start()
    took = [seconds.get() for _ in processes]
    for process in processes:
        process.join()
    return workers * len(specs) / max(took)


def run_bench(scenes: int, rounds: int, progress: Callable[[str], None]) -> dict[str, float]:
    """Ticks per second of one core, the median over rounds of ticks by seconds over all scenes, by loop; mean vehicles;
    ms to a new episode in a warm worker; two workers by one.
    """
    specs = bench_scenes(scenes)
    loops = _Loops()
    rates: dict[str, list[float]] = {"bare": [], "ego": [], "full": []}
    starts: list[float] = []
    vehicles: list[float] = []
    for number in range(rounds):
        progress(f"round {number + 1} of {rounds}")
        sums: dict[str, list[float]] = {name: [0.0, 0.0] for name in rates}
        for spec in specs:
            full = loops.full(spec)
            for name, (seconds, ticks) in {
                "bare": loops.bare(spec),
                "ego": loops.ego(spec)[:2],
                "full": full[:2],
            }.items():
                sums[name][0] += seconds
                sums[name][1] += ticks
            vehicles.append(full[2] / max(full[1], 1))
            starts.append(full[3])
        for name, (spent, done) in sums.items():
            rates[name].append(done / spent)
    loops.runner.close()
    progress("one worker, then two")
    speedups = [_throughput(specs, 2) / _throughput(specs, 1) for _ in range(max(rounds // 2, 1))]
    return {
        **{f"{name}_ticks_per_s": statistics.median(found) for name, found in rates.items()},
        "vehicles": statistics.mean(vehicles),
        "episode_start_ms": 1000.0 * statistics.median(starts),
        "workers_speedup": statistics.median(speedups),
    }


GOAL_MS: Final = 15.0
_PLANNER = "blind"


def bench_fresh(scenes: int, rounds: int) -> dict[str, float]:
    """Processor time of an episode, ms: medians over rounds of the mean over scenes of dev, played by the worker and in
    its children. Children come first: a worker that forks has played nothing itself.
    """
    rows = sorted(choose(DataSet().table("dev"), scenes), key=lambda row: row.net)
    runner = EpisodeRunner(resolve(_PLANNER))
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

    try:
        found = [
            statistics.median(1000.0 * play() / len(rows) for _ in range(rounds)) for play in (in_children, together)
        ]
    finally:
        runner.close()
    return {"together_ms": found[1], "in_child_ms": found[0]}


PLANNERS: Final = ("idm", "idm-e")
GOAL_US: Final = 150.0


@dataclass(frozen=True)
class Price:
    """Median times of a planner's answer by the clock, µs: of the best of the rounds, as others use the machine, too.

    together: in the referee's process; None for a program. isolated: on the referee's processor, as where workers use
    all of them. apart: on any processor, which may have to be woken up for each answer.
    """

    planner: str
    together_us: float | None
    isolated_us: float
    apart_us: float


def bench_isolation(planners: Sequence[str], scenes: int, rounds: int) -> list[Price]:
    """Raises InputError for a planner that does not come up."""
    data = DataSet()
    rows = choose(data.table("dev"), scenes)
    loader = SceneLoader(data)
    with closing(Simulation()) as simulation:

        def took(runner: EpisodeRunner) -> float:
            return 1e6 * float(np.median(np.concatenate([runner.run(row).planner_s for row in rows])))

        def runner_of(planner: LoadedPlanner) -> EpisodeRunner:
            return EpisodeRunner(planner, simulation=simulation, loader=loader)

        found = []
        for name in planners:
            here = None if PlannerSpec.parse(name).isolated_only else runner_of(resolve(name))
            info = describe(name).planner
            beside, free = runner_of(load(info, show=True)), runner_of(load(info, show=True))
            together, isolated, apart = [], [], []
            for _ in range(rounds):
                if here is not None:
                    together.append(took(here))
                # Where the planner's process is started is where it stays.
                with _one_processor():
                    isolated.append(took(beside))
                apart.append(took(free))
            found.append(Price(info.name, min(together, default=None), min(isolated), min(apart)))
    return found


@contextmanager
def _one_processor() -> Iterator[None]:
    """This process, and what it starts, on the first of its processors."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


_ROUNDS, _BATCH = 30, 8
WHOLE = "plant2-ft"
_SCENES, _WHOLE_ROUNDS = 4, 3


def bench_networks() -> Iterator[tuple[str, float, float]]:
    """(planner, CPU ms for one answer alone, ms for each of eight); the least over many rounds, as others disturb."""
    for name in NETWORKS:
        infer = batched(name).network("cpu")
        asked = np.resize(questions(name), _BATCH)
        yield name, _least(infer, asked[:1]), _least(infer, asked) / _BATCH


def bench_whole() -> float:
    """CPU ms of a tick of WHOLE's episodes with all that belongs to them, on scenes of the dev split: least of a few
    rounds.
    """
    rows = choose(DataSet().table("dev"), _SCENES)
    runner = EpisodeRunner(resolve(WHOLE))
    took = []
    for _ in range(_WHOLE_ROUNDS):
        began = time.process_time()
        ticks = sum(len(runner.run(row).commands) for row in rows)
        took.append(1000.0 * (time.process_time() - began) / ticks)
    runner.close()
    return min(took)


def _least(infer: Infer, asked: Records) -> float:
    took = []
    for _ in range(_ROUNDS):
        began = time.process_time()
        infer(asked)
        took.append(time.process_time() - began)
    return 1000.0 * min(took)
