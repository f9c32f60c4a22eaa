"""The journal: finished episodes, one checked line each, so that a kill loses no finished one."""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

from tsbench.errors import InputError
from tsbench.run.files import replacing, told_plainly, write_atomic
from tsbench.run.record import Record

Key = tuple[str, str]

_SYNC_EVERY_S = 1.0
_DIGEST_HEX = 16


class Journal:
    """`RUN/journal.jsonl`: append-only while a run is on.

    A line is the checksum of the rest, a space, and one episode as JSON. `done`: where the line of each
    finished (planner, scenario_id) begins. `set_aside`: file that took up lines that cannot be trusted, None
    if all could.
    """

    def __init__(self, path: Path, keys: Collection[Key], aside: Path) -> None:
        """Open for appending. keys: the episodes of this run; a line of any other one is not trusted."""
        self.path = path
        self.done: dict[Key, int] = {}
        self.set_aside: Path | None = None
        with told_plainly(path):
            self._fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
            self._lock()
            self._recover(keys, aside)
            self._end = os.fstat(self._fd).st_size
        self._synced = time.monotonic()

    def append(self, record: Record) -> None:
        """Keep one episode. Raises InputError if the disk does not take it."""
        row = record.row
        line = encode({"row": row, "events": record.events, "timing": record.timing})
        with told_plainly(self.path):
            start, rest = self._end, memoryview(line)
            while rest:
                rest = rest[os.write(self._fd, rest) :]
            self._end = start + len(line)
            self.done[row["planner"], row["scenario_id"]] = start
            now = time.monotonic()
            if now - self._synced >= _SYNC_EVERY_S:
                os.fdatasync(self._fd)
                self._synced = now

    def read(self, key: Key) -> dict[str, Any]:
        """The content of one line: row, events, timing."""
        start = self.done[key]
        with told_plainly(self.path):
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
        """Sync and let go."""
        with told_plainly(self.path):
            os.fdatasync(self._fd)
        os.close(self._fd)

    def _lock(self) -> None:
        try:
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(self._fd)
            raise InputError(f"{self.path.parent}: another tsbench run is writing here") from None

    def _recover(self, keys: Collection[Key], aside: Path) -> None:
        """Index the good lines; move the others out of the way."""
        known = frozenset(keys)
        good: list[tuple[int, int]] = []
        bad: list[bytes] = []
        kept = position = 0
        with self.path.open("rb") as file:
            for line in file:
                key = _key(decode(line))
                if key is None or key not in known or key in self.done:
                    bad.append(line)
                else:
                    self.done[key] = kept
                    good.append((position, len(line)))
                    kept += len(line)
                position += len(line)
        if bad:
            aside.mkdir(exist_ok=True)
            self.set_aside = _spare_name(aside)
            write_atomic(self.set_aside, b"".join(bad))
            self._rewrite(good)

    def _rewrite(self, good: list[tuple[int, int]]) -> None:
        """Keep only these (position, length) of the file."""
        with replacing(self.path) as tmp, tmp.open("wb") as out:
            for position, length in good:
                out.write(os.pread(self._fd, length, position))
        # The name now stands for the new file: append to that one, and lock it too.
        os.close(self._fd)
        self._fd = os.open(self.path, os.O_RDWR | os.O_APPEND | os.O_CLOEXEC)
        self._lock()


def encode(content: dict[str, Any]) -> bytes:
    """A line with its checksum."""
    text = json.dumps(content, separators=(",", ":")).encode()
    return _digest(text) + b" " + text + b"\n"


def decode(line: bytes) -> dict[str, Any] | None:
    """The content of a line, None if it is torn or changed."""
    if not line.endswith(b"\n") or line[_DIGEST_HEX : _DIGEST_HEX + 1] != b" ":
        return None
    text = line[_DIGEST_HEX + 1 : -1]
    if _digest(text) != line[:_DIGEST_HEX]:
        return None
    content: dict[str, Any] = json.loads(text)
    return content


def _digest(text: bytes) -> bytes:
    return hashlib.blake2b(text, digest_size=_DIGEST_HEX // 2).hexdigest().encode()


def _key(content: dict[str, Any] | None) -> Key | None:
    if content is None or not isinstance(content.get("row"), dict):
        return None
    return content["row"].get("planner", ""), content["row"].get("scenario_id", "")


def _spare_name(folder: Path) -> Path:
    number = 1
    while (folder / f"journal-{number}.txt").exists():
        number += 1
    return folder / f"journal-{number}.txt"
