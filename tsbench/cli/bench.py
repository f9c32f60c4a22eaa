"""`tsbench bench`: how fast the harness is on this machine: three loops over the same scenes, in one run, as ratios.

bare: SUMO alone steps the scene. ego: the ego is placed along its route and the world around it is read. full: the
whole tick with `idm`, monitors and recording. Machines are noisy: the loops take turns, their seconds are the process's
own on the CPU, and only ratios compare. Two workers against one are timed by the clock, on a machine left alone.
`packaging/benches.py` has benches of the harness's parts.
"""

from __future__ import annotations

import multiprocessing
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from multiprocessing.synchronize import Barrier
from pathlib import Path

import click
from rich.console import Console

from tsbench.cli.console import print_table
from tsbench.cli.options import FILE, POSITIVE
from tsbench.core.files import write_json
from tsbench.episode.outcome import Phase
from tsbench.episode.runner import EpisodeRunner
from tsbench.metrics.episode_metrics import episode_metrics
from tsbench.planners.registry import resolve
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


@click.command()
@click.option("--limit", type=POSITIVE, metavar="N", default=12, show_default=True, help="How many scenes.")
@click.option("--rounds", type=POSITIVE, default=5, show_default=True, help="Medians over so many rounds.")
@click.option("--json", "json_path", type=FILE, metavar="FILE", help="Write the figures here.")
def bench(limit: int, rounds: int, json_path: Path | None) -> None:
    """Measure bare SUMO, ego and snapshot, and the whole tick, on the same scenes in one run."""
    console = Console()
    with console.status("choosing scenes") as status:
        result = run_bench(limit, rounds, lambda text: status.update(text))
    ego, full = result["ego_ticks_per_s"], result["full_ticks_per_s"]
    loops = {
        "bare libsumo step": result["bare_ticks_per_s"],
        "ego placed, surroundings read": ego,
        "whole tick: idm, monitors, recording": full,
    }
    rows = [(name, f"{speed:,.0f}", f"{full / speed:.0%}") for name, speed in loops.items()]
    title = f"{result['vehicles']:.1f} vehicles on average"
    print_table(("loop", "ticks/s per core", "share of a tick"), rows, title=title)
    console.print(f"whole tick by ego tick: {ego / full:.2f}x (goal: at most 3)")
    console.print(f"a new episode in a warm worker starts within {result['episode_start_ms']:.0f} ms (goal: 50)")
    console.print(f"two workers by one: {result['workers_speedup']:.2f}x (goal: 1.9)")
    if json_path is not None:
        write_json(json_path, {name: round(figure, 4) for name, figure in result.items()})
