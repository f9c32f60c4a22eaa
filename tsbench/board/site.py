"""The leaderboard as a static site: an index of rows by data set and perception level, and a page for each planner."""

from __future__ import annotations

import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from markupsafe import Markup

from tsbench.board import curves
from tsbench.board.board_rows import PAGE, BoardRow, SeedRows, latest, read_rows, seeds_of
from tsbench.board.players import show_failures
from tsbench.board.submission import Figure, Submission
from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.episode.perception_level import EXACT
from tsbench.metrics.scd import NAMES, PARTS, SIGNED_ONES
from tsbench.report.page.page_format import render_page
from tsbench.report.page.report_page import PLAYER_SCRIPTS
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.model import GROUPS

_INDEX = "index.html"
_SCRIPTS = ("leaderboard.js",)
Compared = tuple[str, str, str]


def build_site(folder: Path, out: Path, players: int) -> int:
    """Write the site of all submissions and verifications below a folder; how many rows it has.

    players: failures that can be watched, for each submission beside which its traces lie. Raises InputError as
    `read_rows` and `show_failures` do.
    """
    rows = sorted(read_rows(folder), key=lambda row: row.rank_by)
    sets: dict[Compared, list[BoardRow]] = {}
    planners: dict[str, list[BoardRow]] = {}
    for row in rows:
        sets.setdefault(row.data_set, []).append(row)
        planners.setdefault(row.page, []).append(row)
    # Those whose figures were computed again first, then by size.
    order = sorted(sets, key=lambda key: (not any(row.checked for row in sets[key]), -len(sets[key]), key))
    shown = [_data_set(sets[key]) for key in order]
    pages = {_INDEX: render_page("leaderboard.html", title="tsbench leaderboard", scripts=_SCRIPTS, sets=shown)}
    for name, own in planners.items():
        pages[name] = _planner_page(own, sets, players)
    with io_errors_as_input_errors(out):
        _swap_in(out, pages)
    return len(rows)


def _swap_in(out: Path, pages: Mapping[str, str]) -> None:
    """Write the pages beside the site that is there, then put them in its place: readers see the old one or the new.

    Raises InputError for a folder with other things in it.
    """
    for path in out.iterdir() if out.exists() else ():
        if path.name != _INDEX and not PAGE.fullmatch(path.name):
            raise InputError(f"{out}: {path.name} is no page of a leaderboard: choose a folder of its own with --out")
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out.parent, prefix=f".{out.name}.", suffix=".tmp") as beside:
        new, old = Path(beside, "new"), Path(beside, "old")
        new.mkdir()
        for name, text in pages.items():
            write_atomic(new / name, text.encode())
        if out.exists():
            out.rename(old)
        new.rename(out)


def _data_set(rows: Sequence[BoardRow]) -> dict[str, Any]:
    """The rows of one contract by level, with the panels that any of them has, and the curves of their planners."""
    edition, split, contract = rows[0].data_set
    figures = _parts(rows)
    primary = figures[0] if figures else SIGNED_ONES
    by_level = groupby(sorted(rows, key=lambda row: row.level_rank), key=lambda row: row.level_rank)
    planners = dict.fromkeys(row.planner_id for row in rows)
    by_planner = ([row for row in rows if row.planner_id == planner] for planner in planners)
    drawn = [(own[0], _curve(own, rows)) for own in by_planner]
    return {
        "title": f"{edition}, {split} split",
        "contract": contract,
        "id": f"set-{contract[:8]}",
        "figures": figures,
        "primary": primary,
        "panels": [g for g in GROUPS if any(row.figure(primary, g) for row in rows)],
        "levels": [_level(sorted(some, key=lambda row: row.rank_by)) for _, some in by_level],
        "curves": [(row, svg) for row, svg in drawn if svg is not None],
    }


def _level(rows: list[BoardRow]) -> dict[str, Any]:
    seeds = seeds_of(rows)
    return {
        "chart": _chart([row for row in rows if not row.refuted and row.primary is not None], seeds),
        "name": rows[0].submission.level,
        "rows": [row for row in rows if not row.submission.planner.floor],
        "seeds": seeds,
        "floors": [row for row in rows if row.submission.planner.floor],
    }


def _chart(rows: Sequence[BoardRow], seeds: Sequence[SeedRows]) -> Markup | None:
    """The figures of rows of one level, seeds of a planner as one mark; None where there is but one."""
    names, part = _distinct([row.submission.title for row in rows], rows), _primary_part(rows)
    means = [(one, found) for one in seeds if (found := one.figure(part)) is not None]
    within = {row.sha256 for one, _ in means for row in one.submitted}
    points = [(n, row.primary) for n, row in zip(names, rows, strict=True) if row.primary and row.sha256 not in within]
    for one, (mean, spread) in means:
        mark = Figure(part, curves.SEEDS, mean, mean - spread, mean + spread, len(one.rows))
        points.append((f"{one.name} ({len(one.rows)} seeds)", mark))
    if len(points) < 2:
        return None
    first = rows[0].submission
    return curves.forest(
        sorted(points, key=lambda point: -(point[1].value or 0.0)),
        f"planners-{first.contract[:8]}-{first.level}",
        f"{NAMES[part]} by planner, {first.level} perception",
        {name for name, row in zip(names, rows, strict=True) if row.submission.planner.floor},
    )


def _curve(own: Sequence[BoardRow], rows: Sequence[BoardRow]) -> Markup | None:
    """A planner's curve over the levels of one data set, None where there is but one; rows: all of the data set."""
    levels: dict[tuple[float, str, str], list[BoardRow]] = {}
    for row in own:
        if not row.refuted:
            levels.setdefault(row.level_rank, []).append(row)
    best = [latest(levels[rank]) for rank in sorted(levels)]
    points = [(row.submission.level, row.primary) for row in best]
    known = [(level, figure) for level, figure in points if figure is not None]
    if len(known) < 2:
        return None
    first = own[0]
    name = f"curve-{first.planner_id}-{first.submission.contract[:8]}"
    return curves.curve(known, _floor(rows), name, f"{NAMES[_primary_part(best)]} of {first.submission.title} by level")


def _floor(rows: Sequence[BoardRow]) -> tuple[str, Figure] | None:
    """The best floor of a data set under exact perception: plates are nothing to it, however they are told."""
    floors = [
        (row.submission.title, row.primary)
        for row in rows
        if row.submission.planner.floor and not row.refuted and row.submission.level == EXACT
    ]
    known = [(title, f) for title, f in floors if f is not None and f.value is not None]
    return max(known, key=lambda one: one[1].value or 0.0, default=None)


def _cities(own: Sequence[BoardRow]) -> list[tuple[str, Markup]]:
    """By split a planner's figure over the cities that it drove, where these are several."""
    found: dict[str, dict[str, list[BoardRow]]] = {}
    for row in own:
        if row.submission.level == EXACT and not row.refuted and row.primary is not None:
            found.setdefault(row.submission.split, {}).setdefault(row.submission.city, []).append(row)
    drawn = []
    for split, by_city in sorted(found.items()):
        best = {city: latest(rows) for city, rows in sorted(by_city.items())}
        points = [(city, row.primary) for city, row in best.items() if row.primary is not None]
        if len(points) > 1:
            title = f"{NAMES[_primary_part(list(best.values()))]} of {own[0].submission.title} by city, {split} split"
            drawn.append((split, curves.forest(points, f"cities-{split}", title)))
    return drawn


def _primary_part(rows: Sequence[BoardRow]) -> str:
    return next((part for part in PARTS if all(row.figure(part) for row in rows)), SIGNED_ONES)


def _parts(rows: Sequence[BoardRow]) -> list[str]:
    """The figures of SCD that any of the rows has, the primary one first."""
    return [name for name in PARTS if any(row.figure(name) for row in rows)]


def _planner_page(own: Sequence[BoardRow], sets: dict[Compared, list[BoardRow]], players: int) -> str:
    """A planner: all its submissions, its curves, its failures, and what can be watched of them."""
    rows = sorted(own, key=lambda row: (row.refuted, row.data_set, row.level_rank, row.rank_by))
    labels = _distinct([f"{row.data_set[0]}, {row.submission.split}, {row.submission.level}" for row in rows], rows)
    shown = show_failures(rows, labels, players)
    drawn = []
    for data_set in dict.fromkeys(row.data_set for row in rows):
        svg = _curve([row for row in rows if row.data_set == data_set], sets[data_set])
        if svg is not None:
            drawn.append((f"{data_set[0]}, {data_set[1]} split", svg))
    return render_page(
        "leaderboard_planner.html", title=rows[0].submission.title, blobs=shown.blobs,
        scripts=(*_SCRIPTS, *(PLAYER_SCRIPTS if shown.count else ())), rows=list(zip(rows, labels, strict=True)),
        curves=drawn, cities=_cities(rows), players=shown.count, types=_types, failures=_failures, short=_short,
        figures=_parts(rows), parts=_parts,
    )  # fmt: skip


def _distinct(names: Sequence[str], rows: Sequence[BoardRow]) -> list[str]:
    """The names of rows; those of one name have the beginning of their file's hash, too."""
    return [n if names.count(n) == 1 else f"{n} ({row.sha256[:8]})" for n, row in zip(names, rows, strict=True)]


def _types(row: BoardRow) -> list[tuple[str, list[Figure | None]]]:
    """Each type that has figures, with those of `_parts`."""
    kinds, parts = (kind.id for kind in DataSet().catalog.every_type), _parts([row])
    found = [(kind, [row.figure(name, kind) for name in parts]) for kind in kinds]
    return [(name, figures) for name, figures in found if any(f is not None for f in figures)]


def _failures(submission: Submission) -> list[tuple[str, int]]:
    """Clauses, and outcomes that are no arrival, with how many episodes have them, the most frequent first."""
    found: Counter[str] = Counter()
    for episode in submission.episodes:
        found.update(episode.clauses)
        if episode.outcome != "arrived":
            found[f"outcome: {episode.outcome}"] += 1
    return sorted(found.items(), key=lambda item: (-item[1], item[0]))


def _short(value: object) -> str:
    return value[:12] if isinstance(value, str) else "–"
