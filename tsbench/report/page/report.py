"""`tsbench report`: one HTML file about some runs, and the same page for the server."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.report.analyses.pool import Pool, read_pool
from tsbench.report.page.content import about, episodes_table, heading, sections
from tsbench.report.page.embed import Embedded, embed
from tsbench.report.page.episode_index import EpisodeIndex, index_episodes
from tsbench.report.page.shell import render_page

MEGABYTE = 1_000_000
NAME = "report.html"
_SCRIPTS = ("player.js", "report.js")


@dataclass(frozen=True)
class Written:
    """A report on disk. size: bytes; players, traced, episodes: how many; player_bytes: what the players take."""

    path: Path
    size: int
    players: int
    traced: int
    episodes: int
    player_bytes: int
    notes: tuple[str, ...]


def write_report(
    runs: Sequence[Path], out: Path | None, *, allow_partial: bool, max_mb: float, workers: int,
    progress: Callable[[int, int], None],
) -> Written:  # fmt: skip
    """Write the report of `runs` to `out` (default: report.html in the run, or here for several).

    max_mb: bound of the file's size in 10^6 bytes; players are left out until it is kept.

    Raises:
        InputError: as `read_pool`; a file that cannot be written; a bound that even a page without players breaks.
    """
    pool = read_pool(runs, allow_partial)
    stock = index_episodes(pool)
    path = out if out is not None else (runs[0] if len(runs) == 1 else Path()) / NAME
    bound = int(max_mb * MEGABYTE)
    fixed = Fixed(pool, stock)
    bare = len(fixed.page(Embedded()).encode())
    if bare > bound:
        raise InputError(
            f"{path}: without any player the page has {bare / MEGABYTE:.1f} MB: raise --max-mb {max_mb:g}"
        )
    # The flags of what can be played change by a few bytes in the table.
    players = embed(stock, bound - bare - len(stock.rows) - 4096, workers, progress)
    text = fixed.page(players).encode()
    with io_errors_as_input_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, text)
    return Written(
        path, len(text), len(players.rows), len(stock.traces), len(stock.rows), players.size,
        (*stock.notes, *players.notes),
    )  # fmt: skip


def served_page(pool: Pool, stock: EpisodeIndex, source: str) -> str:
    """The page of a run that is served: every traced episode is fetched from below `source` when it is played."""
    return Fixed(pool, stock).page(Embedded(rows=set(stock.traces)), source)


class Fixed:
    """What a report shows whatever players it has, made once."""

    def __init__(self, pool: Pool, stock: EpisodeIndex) -> None:
        self._stock = stock
        self._heading = heading(pool)
        self._sections = list(sections(pool, stock))
        self._about = about(pool)

    def page(self, players: Embedded, source: str | None = None) -> str:
        """The page with these players."""
        data: dict[str, Any] = {} if source is None else {"source": source}
        blobs = {"episodes": episodes_table(self._stock, players.rows), **players.blobs}
        return render_page(
            "report.html", data=data, blobs=blobs, scripts=_SCRIPTS, served=source is not None,
            sections=self._sections, runs=self._about, notes=[*self._stock.notes, *players.notes],
            players=len(players.rows), episodes=len(self._stock.rows), **self._heading,
        )  # fmt: skip
