"""The journal: finished episodes, one checked line each, so that a kill loses no finished one.

The run's three tables are written from it, the same bytes however the episodes came about.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import time
from collections import Counter
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow.json import ParseOptions, ReadOptions, read_json

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, replacing, sha256_of, write_atomic
from tsbench.core.parquet import OSM_LICENCE, VERSION_KEY, open_table
from tsbench.metrics.episode_metrics import EPISODE_METRICS
from tsbench.run.log.record import EPISODES, LATER, SCHEMA_VERSION, TABLES, TIMING, VIOLATIONS, Record

JOURNAL = "journal.jsonl"
Key = tuple[str, str]
Content = dict[str, Any]

_SYNC_EVERY_S = 1.0
_DIGEST_HEX = 16
_PARTS = {"row", "events", "timing", "trace"}
# Lists of texts, in lines of episodes that have some: lines of `opened_files.hashes`, and what was left.
_LATER = ("opened", "left")
_TORN, _OTHER_RUN, _FOREIGN = "torn or changed", "of another run", "of no episode of this run"
_TWICE, _NO_TRACE = "of an episode that has one already", "of an episode whose trace is gone or was changed"


class Journal:
    """`RUN/journal.jsonl`: append-only while a run is on.

    A line is the checksum of the rest, a space, and JSON: first the run that the file belongs to, then an episode
    in each line. `done`: where the line of each finished (planner, scenario_id) begins.
    """

    def __init__(
        self,
        path: Path,
        keys: Collection[Key],
        run: str,
        aside: Quarantine,
        sound: Callable[[Content], bool],
        whole: Callable[[Any], bool] | None = None,
        unsound: str = _NO_TRACE,
    ) -> None:
        """Open for appending; lines that cannot be trusted are set aside, and their episodes are not `done`.

        keys: the episodes of this run. run: its identity. sound: does all exist that an episode's line names?
        unsound: the reason to report if not. whole: is a line complete? None = for the tables.
        """
        self.path = path
        self.done: dict[Key, int] = {}
        self._keys, self._sound, self._unsound = frozenset(keys), sound, unsound
        self._whole = whole or _has_all
        self._head = encode({"run": run})
        with io_errors_as_input_errors(path):
            self._fd = open_locked(path, os.O_CREAT)
            self._recover(aside)
            self._end = os.fstat(self._fd).st_size
        self._synced = time.monotonic()

    def append(self, record: Record) -> None:
        """Keep one episode. Raises InputError if the disk does not take it."""
        row = record.row
        later = {key: value for key in _LATER if (value := list(getattr(record, key)))}
        parts = {"row": row, "events": record.events, "timing": record.timing, "trace": record.trace_sha256}
        line = encode({**parts, **later})
        with io_errors_as_input_errors(self.path):
            try:
                _write(self._fd, line)
            except OSError:
                # What came through of the line goes again: the file ends with a whole one.
                os.ftruncate(self._fd, self._end)
                raise
            self.done[row["planner"], row["scenario_id"]] = self._end
            self._end += len(line)
            now = time.monotonic()
            if now - self._synced >= _SYNC_EVERY_S:
                os.fdatasync(self._fd)
                self._synced = now

    def read(self, key: Key) -> Content:
        """The content of one line: row, events, timing, and the SHA-256 of its trace."""
        start = self.done[key]
        with io_errors_as_input_errors(self.path):
            raw = b""
            while not raw.endswith(b"\n"):
                piece = os.pread(self._fd, 1 << 13, start + len(raw))
                if not piece:
                    break
                raw += piece
                raw = raw[: raw.find(b"\n") + 1] if b"\n" in raw else raw
        content = decode(raw)
        if content is None:
            raise InputError(f"{self.path}: byte {start}: changed while the run was on")
        return content

    def close(self) -> None:
        try:
            with io_errors_as_input_errors(self.path):
                os.fdatasync(self._fd)
        finally:
            os.close(self._fd)

    def _recover(self, aside: Quarantine) -> None:
        """Index the good lines; move the others out of the way."""
        good: list[tuple[int, int]] = []
        bad: list[bytes] = []
        why: Counter[str] = Counter()
        with self.path.open("rb") as file:
            head = file.readline()
            ours = head == self._head
            if head and not ours:
                bad.append(head)
                why[_OTHER_RUN if decode(head) else _TORN] += 1
            kept, position = len(self._head), len(head)
            for line in file:
                content = decode(line)
                fault = self._fault(content) if ours else _OTHER_RUN
                if fault or content is None:
                    bad.append(line)
                    why[fault] += 1
                else:
                    self.done[_key(content)] = kept
                    good.append((position, len(line)))
                    kept += len(line)
                position += len(line)
        if bad:
            told = ", ".join(f"{count} {fault}" for fault, count in why.items())
            aside.keep(self.path, b"".join(bad), f"lines that are not trusted ({told})")
            self._rewrite(good)
        elif not head:
            _write(self._fd, self._head)

    def _fault(self, content: Content | None) -> str:
        """Why a line is not to be trusted, "" if it is."""
        if content is None:
            return _TORN
        if not self._whole(content) or _key(content) not in self._keys:
            return _FOREIGN
        if _key(content) in self.done:
            return _TWICE
        return "" if self._sound(content) else self._unsound

    def _rewrite(self, good: list[tuple[int, int]]) -> None:
        """Keep only these (position, length) of the file, below our own first line."""
        with replacing(self.path) as tmp, tmp.open("wb") as out:
            out.write(self._head)
            for position, length in good:
                out.write(os.pread(self._fd, length, position))
        # The name now stands for the new file: append to that one, and lock it too.
        os.close(self._fd)
        self._fd = open_locked(self.path)


def lines_so_far(path: Path) -> list[Content]:
    """The episodes in a journal that another process may be writing to; [] without a file. Nothing is locked.

    Raises InputError where it cannot be read. A line that is torn is left out.
    """
    if not path.is_file():
        return []
    with io_errors_as_input_errors(path):
        lines = path.read_bytes().splitlines(keepends=True)[1:]
    return [content for line in lines if (content := decode(line)) is not None and _has_all(content)]


def belongs(path: Path, run: str) -> bool:
    """Is this file the journal of the run with this identity? Raises OSError where it cannot be read."""
    with path.open("rb") as file:
        return file.readline() == encode({"run": run})


def encode(content: Content) -> bytes:
    """A line with its checksum."""
    text = json.dumps(content, separators=(",", ":")).encode()
    return _digest(text) + b" " + text + b"\n"


def decode(line: bytes) -> Content | None:
    """The content of a line, None if it is torn or changed."""
    if not line.endswith(b"\n") or line[_DIGEST_HEX : _DIGEST_HEX + 1] != b" ":
        return None
    text = line[_DIGEST_HEX + 1 : -1]
    if _digest(text) != line[:_DIGEST_HEX]:
        return None
    content: Content = json.loads(text)
    return content


def open_locked(path: Path, flags: int = 0) -> int:
    """A descriptor of a journal, opened and locked. Raises InputError if another run has it."""
    fd = os.open(path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC | flags, 0o644)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # Between our opening and locking another run may have put a new file in its place.
        if os.path.samestat(os.fstat(fd), os.stat(path)):  # noqa: PTH116
            return fd
    except (BlockingIOError, FileNotFoundError):
        pass
    os.close(fd)
    raise InputError(f"{path.parent}: another tsbench run is writing here")


def _write(fd: int, content: bytes) -> None:
    rest = memoryview(content)
    while rest:
        rest = rest[os.write(fd, rest) :]


def _digest(text: bytes) -> bytes:
    return hashlib.blake2b(text, digest_size=_DIGEST_HEX // 2).hexdigest().encode()


def _key(content: Content) -> Key:
    return content["row"]["planner"], content["row"]["scenario_id"]


def _has_all(content: Any) -> bool:
    """Is this an episode with exactly the columns that the tables want?"""
    if not isinstance(content, dict) or {*content} - {*_LATER} != _PARTS:
        return False
    if not isinstance(content["events"], list):
        return False
    later = [content.get(key, []) for key in _LATER]
    if not all(isinstance(told, list) and all(isinstance(one, str) for one in told) for told in later):
        return False
    wanted = [(content["row"], EPISODES), (content["timing"], TIMING)]
    wanted += [(event, VIOLATIONS) for event in content["events"]]
    return all(isinstance(row, dict) and set(row) == set(schema.names) for row, schema in wanted)


FOLDER, REASONS = "set_aside", "REASONS.txt"
# Things named one by one on the console; REASONS.txt names all.
_NAMED = 10


class Quarantine:
    """`RUN/set_aside/`: numbered things, and REASONS.txt, which says of each where it was and why it went."""

    def __init__(self, run: Path) -> None:
        self._run, self._folder = run, run / FOLDER
        self._notices: list[str] = []

    def move(self, path: Path, reason: str) -> None:
        """Take something out of the run. Raises InputError if the folder cannot be written."""
        with io_errors_as_input_errors(path):
            target = self._target(path, reason)
            path.rename(target)

    def keep(self, path: Path, content: bytes, reason: str) -> None:
        """Keep a part of a file; its owner takes it out afterwards."""
        with io_errors_as_input_errors(path):
            write_atomic(self._target(path, reason), content)

    def notices(self) -> list[str]:
        """A line for each thing put here since the folder was opened; one for all beyond a few."""
        more = len(self._notices) - _NAMED
        rest = [f"{more} more things set aside: {self._folder / REASONS} names them"] if more > 0 else []
        return [*self._notices[:_NAMED], *rest]

    def _target(self, path: Path, reason: str) -> Path:
        """A free name, its reason written down first: nothing lies there unexplained."""
        self._folder.mkdir(exist_ok=True)
        name = _shown(path.name.lstrip("."))
        number = 1
        while any(self._folder.glob(f"{number}-*")):
            number += 1
        target = self._folder / f"{number}-{name}"
        with (self._folder / REASONS).open("a", encoding="utf-8") as file:
            file.write(f"{target.name}: was {_shown(str(path.relative_to(self._run)))}: {reason}\n")
        self._notices.append(f"{_shown(str(path))}: {reason}; moved to {target}")
        return target


def _shown(name: str) -> str:
    """A name as it may be printed: control characters and broken encodings escaped."""
    return name if name.isprintable() else ascii(name)[1:-1]


_LATER_COLUMNS = (*LATER, *(metric.column for metric in EPISODE_METRICS if metric.failure is None))
# Episodes in one row group. Part of the format: another number gives other bytes.
_GROUP = 4096


def write_tables(folder: Path, journal: Journal, contract: str) -> None:
    """Write episodes, violations and timing, sorted by (planner, scenario_id), in bounded memory."""
    keys = sorted(journal.done)
    # Rows name places of OpenStreetMap's roads: its licence goes along.
    metadata = {VERSION_KEY: str(SCHEMA_VERSION), "tsbench_contract": contract, **OSM_LICENCE}
    with io_errors_as_input_errors(folder), ExitStack() as stack:
        writers = {}
        for name, schema in TABLES.items():
            path = stack.enter_context(replacing(folder / name))
            options = {"version": "2.6", "compression": "zstd", "compression_level": 3}
            writers[name] = stack.enter_context(pq.ParquetWriter(path, schema.with_metadata(metadata), **options))
        for start in range(0, len(keys), _GROUP):
            tables = tables_of([journal.read(key) for key in keys[start : start + _GROUP]])
            for name, writer in writers.items():
                writer.write_table(tables[name], row_group_size=max(len(tables[name]), 1))


def tables_of(lines: Sequence[Mapping[str, Any]]) -> dict[str, pa.Table]:
    """The three tables of lines of a journal, in the order of the lines."""
    rows = {
        "episodes.parquet": [line["row"] for line in lines],
        "violations.parquet": [event for line in lines for event in line["events"]],
        "timing.parquet": [line["timing"] for line in lines],
    }
    return {name: table_of(name, rows[name]) for name in TABLES}


def table_of(name: str, rows: list[dict[str, Any]]) -> pa.Table:
    """Rows as Arrow. A missing key or a null where none may be is a defect, and is said so."""
    schema = TABLES[name]
    for field in schema:
        nulls = sum(row[field.name] is None for row in rows)
        if not field.nullable and nulls:
            raise ValueError(f"{name}: column {field.name} has {nulls} nulls")
    if not rows:
        return schema.empty_table()
    told = "\n".join(json.dumps({key: row[key] for key in schema.names}) for row in rows).encode("ascii")
    # `pa.array` would import pandas, which takes longer than many an episode.
    table = read_json(
        pa.BufferReader(told),
        ReadOptions(use_threads=False, block_size=len(told)),
        ParseOptions(explicit_schema=schema),
    )
    return pa.Table.from_arrays(table.columns, schema=schema)


def read_table(path: Path) -> pa.Table:
    """One of the three tables. Raises InputError for a missing, truncated or foreign one.

    A metric that was declared after it was written has no value in it; one whose failures count is not done without.
    Where it is from before pairs, all its rows are signed ones without a pair.
    """
    schema = TABLES[path.name].with_metadata({VERSION_KEY: str(SCHEMA_VERSION)})
    table = open_table(path, schema, "is the folder a tsbench run that has ended?", later=_LATER_COLUMNS)
    for field in schema:
        if field.name not in table.column_names:
            table = table.append_column(field, pa.repeat(pa.scalar(LATER.get(field.name), field.type), len(table)))
    return table.select(schema.names)


def file_hashes(folder: Path) -> dict[str, str]:
    """SHA-256 (hex) of each of the tables."""
    with io_errors_as_input_errors(folder):
        return {name: sha256_of(folder / name) for name in TABLES}
