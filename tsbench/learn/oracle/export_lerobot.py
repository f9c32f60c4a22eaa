"""Ticks as a LeRobotDataset of version 3.0: Parquet files of ticks and of episodes, and JSON that describes them.

Source: huggingface/lerobot 0.4, `lerobot.datasets`. Tables are flattened, as its readers like them best.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq

from tsbench.core.files import write_json
from tsbench.core.parquet import OSM_LICENCE
from tsbench.envs.scene import EGO, SceneSeen
from tsbench.learn.oracle.ticks import REWARDS, Driven, shapes
from tsbench.sim.world import DT_S

_VERSION = "v3.0"
_FILES_IN_CHUNK = 1000
# Rows of a data file: some 100 MB unpacked.
_ROWS = 20_000
_PLACE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_TEXT = ("scenario_id", "planner", "part", "type", "sign", "half")
_COUNTERS = ("frame_index", "episode_index", "index", "task_index")


class LeRobotWriter:
    """Writes into an empty folder."""

    def __init__(self, folder: Path, seen: SceneSeen) -> None:
        self._folder, self._codes = folder, list(seen.codes)
        self._features = _features(seen)
        self._schema = _schema(self._features)
        self._statistics = {
            name: Statistics(int(np.prod(told["shape"])))
            for name, told in self._features.items()
            if told["dtype"] != "string"
        }
        self._tasks: dict[str, int] = {}
        self._episodes: list[dict[str, Any]] = []
        self._writer: pq.ParquetWriter | None = None
        self._file, self._rows, self._total = -1, _ROWS, 0

    def add(self, drive: Driven) -> None:
        if self._rows >= _ROWS:
            self.close()
            self._file, self._rows = self._file + 1, 0
            path = self._folder / "data" / _PLACE.format(**self._place())
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(path, self._schema, compression="zstd")
        task, count = _task(drive.facts), len(drive.ticks)
        number = self._tasks.setdefault(task, len(self._tasks))
        columns = self._columns(drive, number)
        assert self._writer is not None
        self._writer.write_table(pa.table(columns, schema=self._schema))
        for name, statistics in self._statistics.items():
            statistics.add(np.stack([np.ravel(value) for value in columns[name]]))
        self._episodes.append({
            "episode_index": drive.index, "tasks": [task], "length": count,
            "dataset_from_index": self._total, "dataset_to_index": self._total + count,
            **{f"data/{name}": value for name, value in self._place().items()},
            "meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0,
            **{name: drive.facts[name] for name in _TEXT},
        })  # fmt: skip
        self._rows, self._total = self._rows + count, self._total + count

    def end(self) -> None:
        """The descriptions, which need to know all drives."""
        meta = self._folder / "meta"
        place = meta / "episodes" / _PLACE.format(chunk_index=0, file_index=0)
        place.parent.mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist(self._episodes), place)
        pq.write_table(_tasks(self._tasks), meta / "tasks.parquet")
        write_json(meta / "stats.json", {name: told.told() for name, told in self._statistics.items()})
        write_json(
            meta / "info.json",
            {
                "codebase_version": _VERSION, "robot_type": "tsbench ego", "fps": round(1.0 / DT_S),
                "total_episodes": len(self._episodes), "total_frames": self._total, "total_tasks": len(self._tasks),
                "chunks_size": _FILES_IN_CHUNK, "data_files_size_in_mb": 100, "video_files_size_in_mb": 200,
                "splits": {"train": f"0:{len(self._episodes)}"}, "data_path": f"data/{_PLACE}", "video_path": None,
                "features": self._features, "signs": self._codes,
                **OSM_LICENCE,
            },
        )  # fmt: skip

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()

    def _place(self) -> dict[str, int]:
        return {"chunk_index": self._file // _FILES_IN_CHUNK, "file_index": self._file % _FILES_IN_CHUNK}

    def _columns(self, drive: Driven, task: int) -> dict[str, list[Any]]:
        ticks, rows = drive.ticks, range(len(drive.ticks))
        columns: dict[str, list[Any]] = {
            name: [tick[name] for tick in ticks] for name in (*self._flattened(), "action")
        }
        columns |= {f"reward.{name}": [np.float32(t[f"reward.{name}"]) for t in ticks] for name in REWARDS}
        columns["next.done"] = [tick["done"] for tick in ticks]
        columns |= {name: [drive.facts[name]] * len(ticks) for name in _TEXT}
        # Every episode begins at 0, and no tick is left out.
        columns["timestamp"] = [np.float32(k * DT_S) for k in rows]
        columns["frame_index"] = list(rows)
        columns["episode_index"] = [drive.index] * len(ticks)
        columns["index"] = [self._total + k for k in rows]
        columns["task_index"] = [task] * len(ticks)
        return columns

    def _flattened(self) -> list[str]:
        return [name for name in self._features if name.startswith("observation.")]


class Statistics:
    """Least, largest, mean and standard deviation of each number of a column, one drive at a time."""

    def __init__(self, width: int) -> None:
        self._count = 0
        self._sum, self._squares = np.zeros(width), np.zeros(width)
        self._least, self._most = np.full(width, np.inf), np.full(width, -np.inf)

    def add(self, rows: npt.NDArray[Any]) -> None:
        """rows: (n, width)."""
        values = rows.astype(np.float64)
        self._count += len(values)
        self._sum += values.sum(axis=0)
        self._squares += np.square(values).sum(axis=0)
        self._least = np.minimum(self._least, values.min(axis=0))
        self._most = np.maximum(self._most, values.max(axis=0))

    def told(self) -> dict[str, list[float]]:
        mean = self._sum / self._count
        deviation = np.sqrt(np.maximum(self._squares / self._count - mean * mean, 0.0))
        figures = {"min": self._least, "max": self._most, "mean": mean, "std": deviation}
        return {**{name: value.tolist() for name, value in figures.items()}, "count": [self._count]}


def _task(facts: Mapping[str, str]) -> str:
    return f"Reach the destination and obey the traffic sign: {facts['type']}, {facts['half']} half, {facts['sign']}."


def _features(seen: SceneSeen) -> dict[str, dict[str, Any]]:
    def of(kind: str, width: int = 1, names: list[str] | None = None) -> dict[str, Any]:
        return {"dtype": kind, "shape": [width], "names": names}

    found = {name: of("float32", int(np.prod(shape))) for name, shape in shapes(seen).items()}
    found["observation.state"]["names"] = list(EGO)
    found["action"] = of("float32", 2, ["acceleration", "steering"])
    found |= {f"reward.{name}": of("float32") for name in REWARDS}
    found["next.done"] = of("bool")
    found |= {name: of("string") for name in _TEXT}
    found["timestamp"] = of("float32")
    return found | {name: of("int64") for name in _COUNTERS}


def _schema(features: Mapping[str, Mapping[str, Any]]) -> pa.Schema:
    kinds = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_(), "string": pa.string()}
    fields: list[tuple[str, Any]] = []
    for name, told in features.items():
        kind, width = kinds[told["dtype"]], told["shape"][0]
        fields.append((name, kind if width == 1 else pa.list_(kind, width)))
    return pa.schema(fields).with_metadata(OSM_LICENCE)


def _tasks(tasks: Mapping[str, int]) -> pa.Table:
    """A table whose index is the task, as pandas reads it."""
    table = pa.table({"task_index": list(tasks.values()), "task": list(tasks)})
    text = {
        "name": "task",
        "field_name": "task",
        "pandas_type": "unicode",
        "numpy_type": "object",
        "metadata": None,
    }
    number = {
        **text,
        "name": "task_index",
        "field_name": "task_index",
        "pandas_type": "int64",
        "numpy_type": "int64",
    }
    told = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [number, text],
        "pandas_version": "2.0",
    }
    return table.replace_schema_metadata({"pandas": json.dumps(told)})
