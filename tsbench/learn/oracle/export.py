"""The oracle's drives as ticks: each is driven again from its commands, and every tick is a row of a Parquet file.

A drive is a row group, so that neither writing nor reading holds more than one. Numbers are those of the environment's
`scene` observation (scaled, in the ego's frame); tables are flattened, their shapes stand in the file's metadata.
Units: s; action in m/s2 and rad.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.errors import InputError, SimulationError
from tsbench.core.files import io_errors_as_input_errors
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY
from tsbench.envs.reward import RewardSpec, RouteReward
from tsbench.envs.scene import SceneSeen
from tsbench.envs.stepped_episode import Judged, Step, process_episode
from tsbench.episode.result import EpisodeResult
from tsbench.learn.oracle.trajectories import Recorded, Replay, difference, stream_trajectories
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.scenarios.table import read_table, table_path

_SEEN = {
    "state": "ego", "route": "route", "plates": "plates", "plates_mask": "plates_mask",
    "lanes": "lanes", "lanes_mask": "lanes_mask",
}  # fmt: skip
_TEXT = ("scenario_id", "planner", "part", "type", "sign", "half")


def export(path: Path, split: str, out: Path, rank: int = 1, limit: int | None = None) -> tuple[int, int]:
    """Write the ticks of a table's drives up to `rank` (0 = all of them); the numbers of drives and ticks."""
    rows = {row.scenario_id: row for row in read_table(table_path(split))}
    chosen = (
        d for d in stream_trajectories(path) if d.scenario_id in rows and (not rank or 0 < d.rank <= rank)
    )
    seen = SceneSeen()
    schema = _schema(seen)
    part = out.with_name(f"{out.name}.part")
    drives = ticks = 0
    with io_errors_as_input_errors(out), pq.ParquetWriter(part, schema, compression="zstd") as writer:
        for drive in islice(chosen, limit):
            row = rows[drive.scenario_id]
            steps = list(_ticks(drive, row, seen))
            flat = {
                "scenario_id": row.scenario_id, "planner": drive.planner, "part": drive.part,
                "type": row.scenario_type, "sign": row.sign_code, "half": row.half, "episode_index": drives,
            }  # fmt: skip
            writer.write_table(pa.Table.from_pylist([flat | step for step in steps], schema=schema))
            drives, ticks = drives + 1, ticks + len(steps)
    process_episode().close()
    if not drives:
        part.unlink()
        raise InputError(f"{path}: has no drive of split {split} up to rank {rank}")
    part.replace(out)
    return drives, ticks


def _ticks(drive: Recorded, row: ScenarioSpec, seen: SceneSeen) -> Iterator[dict[str, Any]]:
    """A drive's ticks: what is seen, the command, and what it earns. Raises SimulationError as a replay does."""
    replay = Replay(drive)
    turn = process_episode().begin(row, drive, mask_signs=False)
    if isinstance(turn, EpisodeResult):
        raise SimulationError(f"{row.scenario_id}: {turn.error or turn.outcome}")
    replay.reset(turn.context)
    seen.reset(turn.context)
    reward, before = RouteReward(turn.observation, RewardSpec()), process_episode().judged()
    while isinstance(turn, Step):
        o, encoded = turn.observation, seen.encode(turn.observation)
        control = replay.act(o)
        tick = {f"observation.{name}": encoded[key].ravel() for name, key in _SEEN.items()}
        tick |= {"frame_index": o.step, "timestamp": o.time}
        tick["action"] = np.array((control.acceleration, control.steering), dtype=np.float32)
        turn = process_episode().drive(control)
        after, last = _after(turn)
        tick["reward.progress"] = reward.tick(process_episode().last_view())
        tick["reward.violation"] = float(len(before.violations) - len(after.violations))
        tick["reward.needless"] = float(len(before.needless) - len(after.needless))
        tick["reward.end"] = reward.end(last.outcome) if last else 0.0
        tick["done"] = last is not None
        before = after
        yield tick
    differs = difference(drive, row, turn.facts, turn.error)
    if differs:
        raise SimulationError(f"{row.scenario_id}: {drive.planner}: the replay differs: {differs}")


def _after(turn: Step | EpisodeResult) -> tuple[Judged, EpisodeResult | None]:
    if isinstance(turn, Step):
        return process_episode().judged(), None
    if turn.facts is None:
        raise SimulationError(f"{turn.spec.scenario_id}: {turn.error or turn.outcome}")
    return Judged.of(turn.facts), turn


def _schema(seen: SceneSeen) -> pa.Schema:
    numbers = pa.list_(pa.field("element", pa.float32(), nullable=False))
    shapes = {f"observation.{name}": list(seen.space[key].shape) for name, key in _SEEN.items()}  # type: ignore[index]
    fields: list[Any] = [pa.field(name, pa.string()) for name in _TEXT]
    fields += [pa.field(name, pa.int32()) for name in ("episode_index", "frame_index")]
    fields += [pa.field("timestamp", pa.float64())]
    fields += [pa.field(name, numbers) for name in (*shapes, "action")]
    fields += [
        pa.field(f"reward.{name}", pa.float64()) for name in ("progress", "violation", "needless", "end")
    ]
    fields += [pa.field("done", pa.bool_())]
    told = {"shapes": json.dumps(shapes), "signs": json.dumps(list(seen.codes))}
    return pa.schema(fields).with_metadata({VERSION_KEY: "1", **OSM_LICENCE, **told})
