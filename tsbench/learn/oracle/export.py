"""The oracle's drives as a data set of ticks, in a format that others read. No more than one drive is held."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import islice
from pathlib import Path
from typing import Protocol

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, replacing, write_atomic
from tsbench.envs.scene import SceneSeen
from tsbench.learn.oracle.card import NAME as CARD
from tsbench.learn.oracle.card import Card
from tsbench.learn.oracle.export_lerobot import LeRobotWriter
from tsbench.learn.oracle.export_parquet import ParquetWriter
from tsbench.learn.oracle.export_webdataset import WebDatasetWriter
from tsbench.learn.oracle.ticks import Driven, driven
from tsbench.learn.oracle.trajectories import stream_trajectories
from tsbench.run.stepped_episode import process_episode
from tsbench.scenarios.table import read_table, table_path

PARQUET, LEROBOT, WEBDATASET = "parquet", "lerobot", "webdataset"
FORMATS = (PARQUET, LEROBOT, WEBDATASET)


class Writer(Protocol):
    """Writes drives in the order of their numbers; `end` completes what was written."""

    def add(self, drive: Driven) -> None: ...

    def end(self) -> None: ...

    def close(self) -> None: ...


def export(
    path: Path, split: str, out: Path, rank: int = 1, limit: int | None = None, form: str = PARQUET
) -> tuple[int, int]:
    """Write the ticks of a table's drives up to `rank` (0 = all of them); the numbers of drives and ticks.

    out: a file (parquet), or a folder that is not there yet (lerobot, webdataset). A data card stands in the folder or
    beside the file. A failed export leaves nothing.
    """
    rows = {row.scenario_id: row for row in read_table(table_path(split))}
    chosen = (
        d for d in stream_trajectories(path) if d.scenario_id in rows and (not rank or 0 < d.rank <= rank)
    )
    seen = SceneSeen()
    card = Card(seen)
    drives = ticks = 0
    place: AbstractContextManager[Path] = replacing(out) if form == PARQUET else _new_folder(out)
    try:
        with io_errors_as_input_errors(out), place as part:
            writer = _writer(form, part, seen)
            try:
                for drive in islice(chosen, limit):
                    one = driven(drives, drive, rows[drive.scenario_id], seen)
                    writer.add(one)
                    card.add(one)
                    drives, ticks = drives + 1, ticks + len(one.ticks)
                if not drives:
                    raise InputError(f"{path}: has no drive of split {split} up to rank {rank}")
                writer.end()
            finally:
                writer.close()
            told = card.text(path, split, rank, limit, form).encode()
            if form != PARQUET:
                write_atomic(part / CARD, told)
        if form == PARQUET:
            write_atomic(out.with_name(f"{out.stem}.{CARD}"), told)
    finally:
        process_episode().close()
    return drives, ticks


def _writer(form: str, place: Path, seen: SceneSeen) -> Writer:
    if form == PARQUET:
        return ParquetWriter(place, seen)
    return LeRobotWriter(place, seen) if form == LEROBOT else WebDatasetWriter(place, seen)


@contextmanager
def _new_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside `path`, moved there if the block ends well. Raises InputError where something is."""
    if path.exists():
        raise InputError(f"{path}: is there already: name a new folder with --out")
    path.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        yield part
        part.chmod(0o755)
        part.rename(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)
