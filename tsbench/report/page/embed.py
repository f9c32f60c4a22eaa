"""Players that go into a file: as many episodes as its size allows, packed by several processes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from tsbench.core.errors import InputError
from tsbench.report.page.episode import EpisodePacker, Packed, pack_plate
from tsbench.report.page.episode_index import EpisodeIndex, Key, by_interest

_CHUNK = 64
# Around a blob in the page: its element and name.
_WRAP = 80


@dataclass
class Embedded:
    """What goes into the file. blobs: by name; rows: that can be played; notes: on what is not; size: in the page."""

    blobs: dict[str, bytes] = field(default_factory=dict)
    rows: set[int] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    size: int = 0


def embed(stock: EpisodeIndex, room: int, workers: int, progress: Callable[[int, int], None]) -> Embedded:
    """Pack episodes in the order of their interest until `room` bytes of the page are used.

    progress(done, of): is told now and then.
    """
    chosen, broken = Embedded(), list[str]()
    order = by_interest(stock)
    left_out = 0
    for k, (row, packed) in enumerate(_packed(stock, order, workers)):
        if isinstance(packed, str):
            broken.append(packed)
            continue
        if not _take(chosen, row, packed, room):
            left_out = len(order) - k
            break
        progress(k + 1, len(order))
    if left_out:
        chosen.notes.append(
            f"{len(chosen.rows):,} of {len(order):,} traced episodes can be played here (violations first, types and "
            "planners in turn): the others would make the file too large; tsbench view plays all of them"
        )
    if broken:
        more = "; …" if len(broken) > 3 else ""
        chosen.notes.append(f"{len(broken)} traces cannot be played: {'; '.join(broken[:3])}{more}")
    return chosen


def _take(chosen: Embedded, row: int, packed: Packed, room: int) -> bool:
    """Put one episode in, with its roads and plates where they are not there yet; False where there is no room."""
    blobs = {f"episode/{row}": packed.episode}
    if (name := f"roads/{packed.net}") not in chosen.blobs:
        blobs[name] = packed.roads
    for key in packed.plates:
        if (name := f"plate/{key}") not in chosen.blobs:
            blobs[name] = pack_plate(key)
    size = sum(_WRAP + len(name) + 4 * ((len(b) + 2) // 3) for name, b in blobs.items())
    if chosen.size + size > room:
        return False
    chosen.blobs |= blobs
    chosen.rows.add(row)
    chosen.size += size
    return True


def _packed(stock: EpisodeIndex, order: list[int], workers: int) -> Iterator[tuple[int, Packed | str]]:
    jobs = [(stock.traces[row], stock.key(row)) for row in order]
    if workers <= 1 or len(jobs) < _CHUNK:
        yield from ((row, _pack(job)) for row, job in zip(order, jobs, strict=True))
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        for start in range(0, len(jobs), _CHUNK * workers):
            part = slice(start, start + _CHUNK * workers)
            yield from zip(order[part], pool.map(_pack, jobs[part], chunksize=8), strict=True)


def _pack(job: tuple[Path, Key]) -> Packed | str:
    """An episode, or in one line why not: one bad trace is no reason to have no report."""
    try:
        return _packer().pack(*job)
    except InputError as problem:
        return str(problem)


@cache
def _packer() -> EpisodePacker:
    """One for each process."""
    return EpisodePacker()
