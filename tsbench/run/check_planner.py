"""Drives a planner through a few scenes and says in plain words what is wrong with it.

The scenes run in a child process, so that a planner that hangs or kills its process is a finding too.
"""

from __future__ import annotations

import io
import multiprocessing
import os
import re
import shlex
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

import tsbench
from tsbench.core.benchmark import ROWS
from tsbench.episode.outcome import EpisodeResult, Outcome
from tsbench.episode.runner import EpisodeRunner
from tsbench.planners.check import Finding, Level
from tsbench.planners.registry import resolve
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.ego import MAX_ACCEL_MPS2, MAX_DECEL_MPS2, MAX_STEER_RAD

SCENES = 10
_WAIT_LIMIT_S = 60.0
_SLOW_STEP_S = 0.1
_GROWTH_BYTES = 4_000_000
_CHATTY_BYTES = 2_000
# Of a traceback: its lines, what stands behind that of the cause, and files that are not the planner's.
_LINES = re.compile(r'^  File "(.+)", line (\d+), in (.+)$', re.MULTILINE)
_CAUSE = "The above exception was the direct cause"
_OTHERS = re.compile(rf"[/\\](site|dist)-packages[/\\]|^{re.escape(str(Path(tsbench.__file__).parent))}|^<frozen")


@dataclass
class DriveSample:
    """What the child has measured; sent once it is done."""

    results: list[EpisodeResult] = field(default_factory=list)
    again: EpisodeResult | None = None
    fresh: EpisodeResult | None = None
    memory: list[int] = field(default_factory=list)
    printed: int = 0
    first_line: str = ""


def choose(specs: Sequence[ScenarioSpec], count: int = SCENES) -> list[ScenarioSpec]:
    """A few scenes of as many types as may be, empty roads and traffic in turn, the same ones each time."""
    names = sorted({s.scenario_type for s in specs})
    kinds = names if len(names) <= count else [names[k * len(names) // count] for k in range(count)]
    rows = {k: sorted((s for s in specs if s.scenario_type == k), key=lambda s: s.scenario_id) for k in kinds}
    quiet = {k: [s for s in rows[k] if s.variant == 0] for k in kinds}
    busy = {k: [s for s in rows[k] if s.variant != 0] for k in kinds}
    chosen: list[ScenarioSpec] = []
    for turn in range(len(specs)):
        for k, kind in enumerate(kinds):
            # Variant 0 has no background traffic; the others have.
            pool = (quiet if (turn + k) % 2 == 0 else busy)[kind]
            if turn // 2 < len(pool) and len(chosen) < count:
                chosen.append(pool[turn // 2])
    return chosen


def check_driving(
    spec: str, scenes: Sequence[ScenarioSpec], data: DataSet, wait_limit_s: float = _WAIT_LIMIT_S
) -> list[Finding]:
    """Findings from driving the planner through scenes of a data set, the first one three times.

    wait_limit_s: how long one step of the planner, or making it, may take before it is given up.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    beats = context.RawValue("Q", 0)
    child = context.Process(target=_drive, args=(sender, beats, spec, list(scenes), data), daemon=True)
    child.start()
    sender.close()
    done, heard, last = 0, 0, time.monotonic()
    seen: DriveSample | None = None
    while seen is None:
        if receiver.poll(0.5):
            try:
                message = receiver.recv()
            except EOFError:
                break
            if isinstance(message, DriveSample):
                seen = message
            else:
                done += 1
        elif beats.value != heard:
            heard, last = beats.value, time.monotonic()
        elif time.monotonic() - last > wait_limit_s:
            child.kill()
            child.join()
            text = f"gave no answer for {wait_limit_s:.0f} s in scene {done + 1} ({_id(scenes, done)})"
            return [Finding(Level.PROBLEM, "time", text)]
    child.join()
    if seen is None:
        text = f"ended its process (exit code {child.exitcode}) in scene {done + 1} ({_id(scenes, done)})"
        return [Finding(Level.PROBLEM, "process", text)]
    return findings(seen, spec)


def _id(scenes: Sequence[ScenarioSpec], k: int) -> str:
    return scenes[min(k, len(scenes) - 1)].scenario_id


def _drive(sender: Connection, beats: Any, spec: str, scenes: list[ScenarioSpec], data: DataSet) -> None:
    """In the child: every scene once, then the first one again with the same planner and with a new one."""
    seen = DriveSample()

    def beat(_: int) -> None:
        beats.value += 1

    with tempfile.TemporaryFile() as heard:
        # File descriptors, not sys.stdout: libraries print past it.
        sys.stdout.flush()
        os.dup2(heard.fileno(), 1)
        os.dup2(heard.fileno(), 2)
        runner = EpisodeRunner(resolve(spec), heartbeat=beat, data=data)
        for scene in scenes:
            seen.results.append(_light(runner.run(scene)))
            seen.memory.append(_resident())
            sender.send(scene.scenario_id)
        seen.again = _light(runner.run(scenes[0]))
        seen.fresh = _light(EpisodeRunner(resolve(spec), heartbeat=beat, data=data).run(scenes[0]))
        sys.stdout.flush()
        seen.printed = heard.seek(0, io.SEEK_END)
        heard.seek(0)
        seen.first_line = heard.readline(200).decode(errors="replace").strip()
    sender.send(seen)
    sender.close()


def _light(result: EpisodeResult) -> EpisodeResult:
    """Without the snapshots, which are large."""
    return replace(result, facts=None)


def _resident() -> int:
    """Bytes of memory that this process holds; 0 where the system does not say."""
    statm = Path("/proc/self/statm")
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") if statm.exists() else 0


def of_results(results: list[EpisodeResult], spec: str) -> list[Finding]:
    """What the episodes alone say: errors, range of the commands, time, outcomes."""
    return [*_errors(results), *_range(results), *_time(results), *_outcomes(results, spec)]


def findings(seen: DriveSample, spec: str) -> list[Finding]:
    return [
        *_errors(seen.results),
        *_range(seen.results),
        *_determinism(seen),
        *_time(seen.results),
        *_memory(seen.memory),
        _printing(seen),
        *_outcomes(seen.results, spec),
    ]


def _errors(results: list[EpisodeResult]) -> list[Finding]:
    found = []
    bad = [r for r in results if r.outcome.is_error]
    for (outcome, error), count in Counter((r.outcome, r.error) for r in bad).items():
        first = next(r for r in bad if (r.outcome, r.error) == (outcome, error))
        what = {
            Outcome.PLANNER_ERROR: "raised",
            Outcome.INVALID_OUTPUT: "returned an invalid command",
            Outcome.PLANNER_TIMEOUT: "took too long",
        }.get(outcome, "met an error that is not its own")
        level = Level.NOTE if outcome is Outcome.SIM_ERROR else Level.PROBLEM
        text = f"{what} in {count} of {len(results)} scenes: {error}{_raised_at(first.detail)}"
        found.append(Finding(level, "output", text))
    if not bad:
        found.append(Finding(Level.OK, "output", "returns finite commands of the right shape"))
    return found


def _raised_at(detail: str) -> str:
    """Where a planner raised, by the traceback of its error: the last line that is neither tsbench's nor installed."""
    own = [line for line in _LINES.findall(detail.partition(_CAUSE)[0]) if not _OTHERS.search(line[0])]
    return "" if not own else " ({}, line {}, in {})".format(*own[-1])


def _range(results: list[EpisodeResult]) -> list[Finding]:
    commands = np.concatenate([r.commands for r in results]) if results else np.empty((0, 2))
    if not len(commands):
        return []
    a, steer = commands[:, 0], np.abs(commands[:, 1])
    beyond = float(np.mean((a > MAX_ACCEL_MPS2) | (a < -MAX_DECEL_MPS2) | (steer > MAX_STEER_RAD)))
    text = (
        f"accelerations {a.min():.1f} to {a.max():.1f} m/s2, steering up to {np.degrees(steer.max()):.0f} degrees; "
        f"{100 * beyond:.0f} % are beyond the vehicle and get clipped"
    )
    found = [Finding(Level.NOTE if beyond > 0.05 else Level.OK, "range", text)]
    if float(steer.max()) > 2.0 * MAX_STEER_RAD:
        text = "steering is in rad: values this large look like degrees or like a share of full lock"
        found.append(Finding(Level.NOTE, "range", text))
    if float(np.ptp(a)) == 0.0 and float(np.ptp(steer)) == 0.0:
        text = "every command is the same: a planner that never moves breaks no rule and arrives nowhere"
        found.append(Finding(Level.NOTE, "range", text))
    return found


def _determinism(seen: DriveSample) -> list[Finding]:
    first, again, fresh = seen.results[0], seen.again, seen.fresh
    if again is None or fresh is None or first.outcome.is_error:
        return []
    if not np.array_equal(first.commands, fresh.commands):
        text = (
            f"{_difference(first, fresh)} between two new planners on the same scene: results cannot be repeated "
            "(draw from PlannerContext.seed only, never from a global generator)"
        )
        return [Finding(Level.PROBLEM, "determinism", text)]
    if not np.array_equal(first.commands, again.commands):
        text = f"{_difference(first, again)} after other scenes: reset leaves something behind"
        return [Finding(Level.PROBLEM, "determinism", text)]
    return [Finding(Level.OK, "determinism", "same scene, same commands: at once, and after other scenes")]


def _difference(a: EpisodeResult, b: EpisodeResult) -> str:
    n = min(len(a.commands), len(b.commands))
    differs = np.nonzero((a.commands[:n] != b.commands[:n]).any(axis=1))[0]
    return f"commands differ from step {int(differs[0]) if len(differs) else n} on"


def _time(results: list[EpisodeResult]) -> list[Finding]:
    steps = np.concatenate([r.planner_s for r in results])
    if not len(steps):
        return []
    mean, p95, most = float(steps.mean()), float(np.quantile(steps, 0.95)), float(steps.max())
    hours = mean * len(steps) / len(results) * ROWS["test"] / 3600.0
    text = (
        f"{1e3 * mean:.2f} ms a step (95 %: {1e3 * p95:.2f}, most: {1e3 * most:.1f}); about {hours:.1f} h of its own "
        f"time for the {ROWS['test']:,} signed scenes of test on one core"
    )
    return [Finding(Level.NOTE if p95 > _SLOW_STEP_S else Level.OK, "time", text)]


def _memory(memory: list[int]) -> list[Finding]:
    """Growth per scene over the second half: the first scenes fill caches."""
    half = len(memory) // 2
    if len(memory) < 4 or not memory[0]:
        return []
    growth = (memory[-1] - memory[half]) / (len(memory) - 1 - half)
    text = f"{memory[-1] / 1e6:.0f} MB in use, {max(growth, 0.0) / 1e6:+.1f} MB a scene"
    if growth > _GROWTH_BYTES:
        return [Finding(Level.PROBLEM, "memory", f"{text}: it keeps growing, drop an episode's data in reset")]
    return [Finding(Level.OK, "memory", text)]


def _printing(seen: DriveSample) -> Finding:
    if seen.printed > _CHATTY_BYTES:
        text = f"printed {seen.printed / 1e3:.0f} kB, beginning with {seen.first_line!r}: a run throws that away"
        return Finding(Level.NOTE, "printing", text)
    return Finding(Level.OK, "printing", "keeps quiet" if not seen.printed else f"printed {seen.printed} bytes")


def _outcomes(results: list[EpisodeResult], spec: str) -> Iterator[Finding]:
    """How the scenes ended, and the command that drives each that did not arrive, below its outcome."""
    counts = Counter(r.outcome.value for r in results)
    text = ", ".join(f"{n} {name}" for name, n in sorted(counts.items()))
    failed = [r for r in results if r.outcome is not Outcome.ARRIVED]
    yield Finding(Level.NOTE if failed else Level.OK, "outcomes", f"{len(results)} scenes: {text}")
    for r in failed:
        command = shlex.join(["tsbench", "debug", "--planner", spec, "--scenario", r.spec.scenario_id])
        yield Finding(Level.NOTE, r.outcome.value, command)
