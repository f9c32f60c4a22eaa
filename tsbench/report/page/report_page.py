"""`tsbench report`: one HTML file about runs, with as many players as its size allows; and the same page served."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.parallel import Workers, worker_processes
from tsbench.core.parquet import with_text
from tsbench.episode.trace import trace_path
from tsbench.report.analyses.run_pool import EpisodeIndex, RunPool, by_interest, index_episodes, make_pool, read_pool
from tsbench.report.page.episode_player import EpisodePacker, Packed, pack_plate
from tsbench.report.page.page_format import render_page
from tsbench.report.page.report_sections import about, episodes_table, heading, sections
from tsbench.run.log.journal import Key
from tsbench.run.log.read import StoredRun
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.countries import Artwork

# Fewer are packed sooner than processes have started.
_FEW = 64
# Around a blob in the page: its element and name.
_WRAP = 80


@dataclass
class Embedded:
    """What goes into the file. blobs: by name; rows: that can be played; notes: on what is not; size: in the page."""

    blobs: dict[str, bytes] = field(default_factory=dict)
    rows: set[int] = field(default_factory=set)
    notes: list[str] = field(default_factory=list)
    size: int = 0

    def take(self, row: int, packed: Packed, artwork: Artwork, room: int) -> bool:
        """Put one episode in, with its roads and plates where they are not there yet; False where there is no room."""
        blobs = {f"episode/{row}": packed.episode}
        if (name := f"roads/{packed.net}") not in self.blobs:
            blobs[name] = packed.roads
        for key in packed.plates:
            if (name := f"plate/{key}") not in self.blobs:
                blobs[name] = pack_plate(artwork, key)
        size = sum(_WRAP + len(name) + 4 * ((len(b) + 2) // 3) for name, b in blobs.items())
        if self.size + size > room:
            return False
        self.blobs |= blobs
        self.rows.add(row)
        self.size += size
        return True


def embed(index: EpisodeIndex, room: int, workers: int, progress: Callable[[int, int], None]) -> Embedded:
    """Pack episodes in the order of their interest until `room` bytes of the page are used.

    The other half of a failure without a trace is driven again first. progress(done, of): is told now and then.
    """
    chosen, broken, artwork = Embedded(), list[str](), index.data.artwork()
    order = by_interest(index)
    left_out = 0
    for k, (row, packed) in enumerate(_packed(index, order, workers)):
        if isinstance(packed, str):
            broken.append(packed)
            continue
        if not chosen.take(row, packed, artwork, room):
            left_out = len(order) - k
            break
        progress(k + 1, len(order))
    if left_out:
        chosen.notes.append(
            f"{len(chosen.rows):,} of {len(order):,} episodes can be played here (violations first, types and "
            "planners in turn): the others would make the file too large; tsbench view plays all of them"
        )
    if broken:
        more = "; …" if len(broken) > 3 else ""
        chosen.notes.append(f"{len(broken)} episodes cannot be played: {'; '.join(broken[:3])}{more}")
    return chosen


def _packed(index: EpisodeIndex, order: list[int], workers: int) -> Iterator[tuple[int, Packed | str]]:
    jobs = [(index.data, index.homes[index.key(row)[0]], index.key(row)) for row in order]
    few = workers <= 1 or len(jobs) < _FEW
    with worker_processes(1 if few else workers, "packing episodes") as pool:
        packed = (_pack(*job, pool) for job in jobs) if few else pool.ordered(_pack, jobs)
        yield from zip(order, packed, strict=True)


def _pack(data: DataSet, run: Path, key: Key, drives: Workers | None = None) -> Packed | str:
    """An episode, or in one line why not: one bad trace is no reason to have no report.

    drives: where an episode without a trace is driven, None: here, which is a process of its own.
    """
    path = trace_path(run, *key)
    try:
        if not path.is_file() and drives is not None:
            drives.start(drive_again, run, key)()
        elif not path.is_file():
            drive_again(run, key)
        return _packer(data).pack(path, key)
    except InputError as problem:
        return str(problem)


def drive_again(run: Path, key: Key) -> None:
    """Give an episode a trace, in a process that is for this. Raises InputError where it is another than it was."""
    from tsbench.run.run_traces import traces_of  # brings libsumo

    traces_of(run).read(*key)


@cache
def _packer(data: DataSet) -> EpisodePacker:
    """One for each process."""
    return EpisodePacker(data)


MEGABYTE = 1_000_000
NAME = "report.html"
PLAYER_SCRIPTS = ("curves.js", "half.js", "player.js", "report.js")


@dataclass(frozen=True)
class Written:
    """A report on disk. size: bytes; players, playable, episodes: how many; player_bytes: what the players take."""

    path: Path
    size: int
    players: int
    playable: int
    episodes: int
    player_bytes: int
    notes: tuple[str, ...]


def write_report(
    runs: Sequence[Path],
    out: Path | None,
    *,
    allow_partial: bool,
    max_mb: float,
    workers: int,
    progress: Callable[[int, int], None],
) -> Written:
    """Write the report of `runs` to `out` (default: report.html in the run, or here for several).

    max_mb: bound of the file's size in 10^6 bytes; players are left out until it is kept.

    Raises InputError as `read_pool` does, where the file cannot be written, and where even a page without players is
    larger than `max_mb`.
    """
    pool = read_pool(runs, allow_partial)
    index = index_episodes(pool)
    path = out if out is not None else (runs[0] if len(runs) == 1 else Path()) / NAME
    bound = int(max_mb * MEGABYTE)
    fixed = Fixed(pool, index)
    bare = len(fixed.page(Embedded()).encode())
    if bare > bound:
        raise InputError(f"{path}: without any player the page has {bare / MEGABYTE:.1f} MB: raise --max-mb {max_mb:g}")
    # The flags of what can be played change by a few bytes in the table.
    players = embed(index, bound - bare - len(index) - 4096, workers, progress)
    text = fixed.page(players).encode()
    with io_errors_as_input_errors(path):
        write_atomic(path, text)
    played, playable, notes = len(players.rows), len(index.within_reach), (*index.notes, *players.notes)
    return Written(path, len(text), played, playable, len(index), players.size, notes)


def served_page(pool: RunPool, index: EpisodeIndex, source: str) -> str:
    """The page of a run that is served: what is played is fetched from below `source`, driven again where need be."""
    return Fixed(pool, index).page(Embedded(rows=index.within_reach), source)


def episode_page(run: StoredRun, planner: str, scenario_id: str) -> str:
    """A page that plays one traced episode, and beside it the other half of its pair where that has a trace too.

    Raises InputError where there is no such trace, or it cannot be shown.
    """
    rows = run.of(planner)
    row = next((r for r in rows.to_pylist() if r["scenario_id"] == scenario_id), None)
    if row is None:
        raise InputError(f"{run.path}: no episode of {planner} on {scenario_id}")
    shown = "pair_id" if row["pair_id"] else "scenario_id"
    pool = make_pool([replace(run, episodes=with_text(rows, shown, row[shown]))], allow_partial=True)
    # The traces of all other episodes are no strays.
    index = replace(index_episodes(pool), notes=())
    players = embed(index, sys.maxsize, 1, lambda _done, _of: None)
    if (planner, scenario_id) not in map(index.key, players.rows):
        why = "; ".join(players.notes) or "it has no trace (trace='all' keeps all)"
        raise InputError(f"{run.path}: {planner}/{scenario_id} cannot be played: {why}")
    return render_page(
        "report.html", data={"folders": _folders(pool)}, scripts=PLAYER_SCRIPTS,
        blobs={"episodes": episodes_table(index, players.rows), **players.blobs},
        title=f"{planner}: {scenario_id}", partial=False, contract=pool.contract, edition=pool.edition, sections=[],
        headlines=[], cited=[], runs=[], notes=players.notes, players=len(players.rows), episodes=len(index),
    )  # fmt: skip


def _folders(pool: RunPool) -> dict[str, str]:
    """The folder of each planner's run, as a shell takes it."""
    return {name: shlex.quote(str(run.path)) for name, run in pool.home.items()}


class Fixed:
    """What a report shows whatever players it has, made once."""

    def __init__(self, pool: RunPool, index: EpisodeIndex) -> None:
        self._index = index
        self._heading = heading(pool)
        self._sections = list(sections(pool, index))
        self._about = about(pool)
        self._folders = _folders(pool)

    def page(self, players: Embedded, source: str | None = None) -> str:
        data: dict[str, Any] = {"folders": self._folders, **({} if source is None else {"source": source})}
        blobs = {"episodes": episodes_table(self._index, players.rows), **players.blobs}
        return render_page(
            "report.html", data=data, blobs=blobs, scripts=PLAYER_SCRIPTS, served=source is not None,
            sections=self._sections, runs=self._about, notes=[*self._index.notes, *players.notes],
            players=len(players.rows), episodes=len(self._index), **self._heading,
        )  # fmt: skip
