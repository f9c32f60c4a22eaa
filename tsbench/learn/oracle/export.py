"""The oracle's drives as a Parquet file of ticks: a row per tick, a row group per drive.

Each is driven again from its commands. Numbers are those of the environment's `scene` observation (scaled, in the ego's
frame), flattened. Units: s; action in m/s2 and rad. No more than one drive is held. Shapes and signs stand in
the file's metadata, a data card, NAME.README.md, beside the file.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import tsbench
from tsbench.core.errors import InputError, SimulationError
from tsbench.core.files import io_errors_as_input_errors, replacing, write_atomic
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY
from tsbench.episode.episode import Episode
from tsbench.learn.envs.reward import RewardSpec, RouteReward
from tsbench.learn.envs.seen_tables import EGO, SceneSeen
from tsbench.learn.oracle.trajectories import Recorded, Replay, difference, stream_trajectories
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.sim.sumo import Simulation
from tsbench.sim.world import DT_S

# The tables of `scene`, by the name that follows `observation.`.
_TABLES = [f"{name}{mask}" for name in ("plates", "lanes", "actors", "obstacles") for mask in ("", "_mask")]
SEEN = {"state": "ego", "route": "route", **{name: name for name in _TABLES}}
REWARDS = {
    "progress": "share of the way that the tick brought, times soft penalties",
    "violation": "minus the number of violations that began in the tick",
    "needless": "minus the number of acts of needless obedience that began in the tick",
    "end": "-1 at a collision, beside the road and out of time, else 0",
}


def shapes(seen: SceneSeen) -> dict[str, tuple[int, ...]]:
    """Of what is flattened, by column."""
    return {f"observation.{name}": seen.space[key].shape for name, key in SEEN.items()}  # type: ignore[index]


def ticks_of(
    drive: Recorded, row: ScenarioSpec, seen: SceneSeen, begin: Callable[[ScenarioSpec], Episode]
) -> Iterator[dict[str, Any]]:
    """The ticks of a drive, driven again: what is seen, the command, and what it earns.

    begin: makes the episode of a row. Raises SimulationError as a replay does.
    """
    replay = Replay(drive)
    episode = begin(row)
    if episode.result is not None:
        raise SimulationError(f"{row.scenario_id}: {episode.result.error or episode.result.outcome}")
    replay.reset(episode.context)
    seen.reset(episode.context)
    reward, before = RouteReward(episode.observation, RewardSpec()), episode.judged()
    while episode.result is None:
        o = episode.observation
        encoded, control = seen.encode(o), replay.act(o)
        tick = {f"observation.{name}": encoded[key].ravel() for name, key in SEEN.items()}
        tick |= {"frame_index": o.step, "timestamp": o.time}
        tick["action"] = np.array((control.acceleration, control.steering), dtype=np.float32)
        episode.step(control)
        after, last = episode.judged(), episode.result
        if last is not None and last.facts is None:
            raise SimulationError(f"{row.scenario_id}: {last.error or last.outcome}")
        tick["reward.progress"] = reward.tick(episode.look())
        tick["reward.violation"] = float(len(before.violations) - len(after.violations))
        tick["reward.needless"] = float(len(before.needless) - len(after.needless))
        tick["reward.end"] = reward.end(last.outcome) if last else 0.0
        tick["done"] = last is not None
        before = after
        yield tick
    differs = difference(drive, row, episode.result.facts, episode.result.error)
    if differs:
        raise SimulationError(f"{row.scenario_id}: {drive.planner}: the replay differs: {differs}")


_TEXT = ("scenario_id", "planner", "part", "type", "sign", "half")


def export(
    data: DataSet, path: Path, split: str, out: Path, rank: int = 1, limit: int | None = None
) -> tuple[int, int]:
    """Write the ticks of a table's drives up to `rank` (0 = all of them); the numbers of drives and ticks.

    out: a file. A failed export leaves nothing new.
    """
    rows = {row.scenario_id: row for row in data.table(split)}
    chosen = (d for d in stream_trajectories(path) if d.scenario_id in rows and (not rank or 0 < d.rank <= rank))
    seen = SceneSeen()
    card, schema = Card(seen), _schema(seen)
    drives = ticks = 0
    with closing(Simulation()) as simulation, io_errors_as_input_errors(out), replacing(out) as part:
        begin = partial(Episode, simulation=simulation, loader=SceneLoader(data))
        with pq.ParquetWriter(part, schema, compression="zstd") as writer:
            for drive in islice(chosen, limit):
                row = rows[drive.scenario_id]
                names = (drive.scenario_id, drive.planner, drive.part, row.scenario_type, row.sign_code, row.half)
                facts = dict(zip(_TEXT, names, strict=True))
                made = [{**facts, "episode_index": drives, **tick} for tick in ticks_of(drive, row, seen, begin)]
                writer.write_table(pa.Table.from_pylist(made, schema=schema))
                card.add(facts, len(made))
                drives, ticks = drives + 1, ticks + len(made)
        if not drives:
            raise InputError(f"{path}: has no drive of split {split} up to rank {rank}")
        write_atomic(out.with_name(f"{out.stem}.{NAME}"), card.text(path, split, rank, limit).encode())
    return drives, ticks


def _schema(seen: SceneSeen) -> pa.Schema:
    numbers = pa.list_(pa.field("element", pa.float32(), nullable=False))
    flattened = {name: list(shape) for name, shape in shapes(seen).items()}
    fields: list[Any] = [pa.field(name, pa.string()) for name in _TEXT]
    fields += [pa.field(name, pa.int32()) for name in ("episode_index", "frame_index")]
    fields += [pa.field("timestamp", pa.float64())]
    fields += [pa.field(name, numbers) for name in (*flattened, "action")]
    fields += [pa.field(f"reward.{name}", pa.float64()) for name in REWARDS]
    fields += [pa.field("done", pa.bool_())]
    told = {"shapes": json.dumps(flattened), "signs": json.dumps(list(seen.codes))}
    return pa.schema(fields).with_metadata({VERSION_KEY: "1", **OSM_LICENCE, **told})


NAME = "README.md"
_SEEN = {
    "state": f"the ego: {', '.join(EGO)}",
    "route": "points of the navigation's way ahead, in the ego's frame",
    "plates": "plates in sight: place, value, whose lane each is for, one-hot code; the last column is a post whose "
    "plate is not known",
    "plates_mask": "1 where a row of `plates` is one",
    "lanes": "polylines of lanes and of ways through junctions around the ego, with what they are",
    "lanes_mask": "1 where a row of `lanes` is one",
    "actors": "road users in sight: place, heading, speed, size, kind",
    "actors_mask": "1 where a row of `actors` is one",
    "obstacles": "obstacles in sight: place, heading, size",
    "obstacles_mask": "1 where a row of `obstacles` is one",
}


class Card:
    """Counts drives as they are exported, and says what they are."""

    def __init__(self, seen: SceneSeen) -> None:
        self._seen = seen
        self._drives = self._ticks = 0
        self._of: dict[str, Counter[str]] = {name: Counter() for name in ("type", "half", "planner", "part")}

    def add(self, facts: Mapping[str, str], ticks: int) -> None:
        self._drives += 1
        self._ticks += ticks
        for name, counter in self._of.items():
            counter[facts[name]] += 1

    def text(self, table: Path, split: str, rank: int, limit: int | None) -> str:
        """Markdown. table: whose drives they are; the others as they were asked of `export`."""
        sha256 = hashlib.sha256(table.read_bytes()).hexdigest()
        best = f"up to rank {rank}" if rank else "of all ranks"
        few = "" if limit is None else f" --limit {limit}"
        hours = self._ticks * DT_S / 3600.0
        lines = [
            "---", "license: odbl", "task_categories: [robotics, reinforcement-learning]",
            "tags: [autonomous-driving, traffic-signs, imitation-learning]", "---", "",
            "# Drives of tsbench's oracle, tick by tick", "",
            f"{self._drives} drives {best} of the split `{split}`: {self._ticks} ticks of {DT_S:g} s ({hours:.2f} h). "
            f"Each drive obeyed the sign and arrived.", "",
            "Experts drove that are told the rule of the sign. They see others and plates without error. Scenes are "
            "simulated (SUMO) on real roads. There are no camera pictures.", "",
            f"Of `{table.name}` (SHA-256 `{sha256}`), by tsbench {tsbench.__version__}:", "",
            "```", f"tsbench oracle export --split {split} --rank {rank}{few}", "```", "",
            f"Licence: {OSM_LICENCE['licence']}.", "",
            "## What a tick holds", "",
            "Numbers of `observation` are scaled to -1..1.",
            "",
            *_table(("name", "shape", "what"), self._columns()), "",
            "The columns of the one-hot code, in order: "
            f"{', '.join(f'`{code}`' for code in self._seen.codes[:-1])}, not known.", "",
            "## What is in it", "",
            *_table(("", "drives"), self._counts()), "",
        ]  # fmt: skip
        return "\n".join(lines)

    def _columns(self) -> Iterable[tuple[str, str, str]]:
        of = shapes(self._seen)
        for name, what in _SEEN.items():
            shape = of[f"observation.{name}"]
            yield f"`observation.{name}`", " x ".join(map(str, shape)), what
        yield ("`action`", "2", "acceleration (m/s²) and steering (rad, left positive) that were driven in the tick")
        yield from ((f"`reward.{name}`", "1", what) for name, what in REWARDS.items())
        yield "`timestamp`, `done`", "1", "s since the episode began; the drive's last tick"
        yield ("`scenario_id`, `planner`, `part`", "1", "which drive, whose, and whether for training or validation")
        yield ("`type`, `sign`, `half`", "1", "of the scene: its type, its sign's code, and which half of a pair")

    def _counts(self) -> Iterable[tuple[str, str]]:
        for name, counter in self._of.items():
            for value, count in sorted(counter.items()):
                yield f"{name} `{value}`", str(count)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> list[str]:
    first, *rest = (f"| {' | '.join(row)} |" for row in (head, *rows))
    return [first, f"|{'---|' * len(head)}", *rest]
