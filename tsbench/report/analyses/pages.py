"""Markdown pages that hold tables and figures of analyses: what stands between two marks is written anew.

A page asks by comments, which readers do not see:

<!-- analysis main | columns planner, figure, SCD all | contract -->      the table of main.md, some columns of it
<!-- end -->
<!-- analysis types | bare -->       values without intervals and counts
<!-- end -->
<!-- analysis floor | where over = type -->    the rows that have this in a column
<!-- end -->
<!-- analysis floor | planners idm, coin -->     the rows of these planners
<!-- end -->
<!-- analysis floor | csv floor-types -->     a link to tables/floor-types.csv beside the page; the last word
<!-- end -->
<!-- analysis metrics -->            the columns of an episode's metrics, as the code declares them; so is `scene`
<!-- end -->
<!-- figure types -->                types.png is copied to where the next line's picture is
"""

from __future__ import annotations

import html
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from tsbench.core.errors import InputError
from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.text import csv_text
from tsbench.metrics.episode_metrics import EPISODE_METRICS
from tsbench.metrics.scd import NAMES
from tsbench.report.analyses.analysis import markdown_row
from tsbench.signs.model import GROUPS

_BLOCK = re.compile(r"<!-- analysis (\S+)((?: \| [^|>]+?)*) -->\n(.*?)<!-- end -->", re.DOTALL)
_FIGURE = re.compile(r"<!-- figure (\S+) -->\n!\[[^\]]*\]\(([^)]+)\)")
_CONTRACT = re.compile(r"Contract `[0-9a-f]+`")
_BESIDE = ("n", "figure")
_BY_GROUP = frozenset(f"{figure} {group}" for figure in NAMES.values() for group in GROUPS)
# Where an end is negative, "to" stands between the two.
_VALUE = re.compile(r"(\S+) \((\S+)(?:–| to )(\S+)\)")
_INTERVAL = re.compile(r" \([^()]*\)$")


Rows = Sequence[Sequence[str]]
# Tables that the code declares; the first row is the heads.
DECLARED: Mapping[str, Callable[[], Rows]] = MappingProxyType(
    {"metrics": lambda: [("column", "meaning"), *((f"`{one.column}`", one.meaning) for one in EPISODE_METRICS)]}
)


def refresh(page: Path, folder: Path, declared: Mapping[str, Callable[[], Rows]] = DECLARED) -> list[Path]:
    """Fill a page from the files of `tsbench analyse` below `folder`, or from `declared`; returns what was written.

    Raises InputError: no page, a mark without its end, an analysis, figure or column that is not there.
    """
    text = page.read_text(encoding="utf-8") if page.is_file() else ""
    blocks = _BLOCK.findall(text)
    if not blocks and not _FIGURE.search(text):
        raise InputError(f"{page}: no page that asks for analyses (<!-- analysis NAME --> … <!-- end -->)")
    if len(blocks) != text.count("<!-- analysis "):
        raise InputError(f"{page}: an <!-- analysis … --> has no <!-- end -->, or options that cannot be read")

    tables: dict[Path, str] = {}

    def fill(found: re.Match[str]) -> str:
        name, options, _ = found.groups()
        told = _markdown(declared[name]()) if name in declared else _told(page, folder / f"{name}.md")
        words = [word.strip() for word in options.split(" | ") if word.strip()]
        *_, last = words or [""]
        if not last.startswith("csv "):
            return f"<!-- analysis {name}{options} -->\n{_table(page, told, words)}\n<!-- end -->"
        place = f"tables/{last.removeprefix('csv ')}.csv"
        tables[page.parent / place] = _csv(_table(page, told, words[:-1]))
        return f"<!-- analysis {name}{options} -->\n[`{place}`]({place})\n<!-- end -->"

    filled = _BLOCK.sub(fill, text)
    for path, table in tables.items():
        with io_errors_as_input_errors(path):
            write_atomic(path, table.encode())
    written = list(tables)
    for name, place in _FIGURE.findall(text):
        target = page.parent / place
        with io_errors_as_input_errors(folder / f"{name}.png"):
            write_atomic(target, (folder / f"{name}.png").read_bytes())
        written.append(target)
    with io_errors_as_input_errors(page):
        write_atomic(page, filled.encode())
    return [page, *written]


def _markdown(rows: Rows) -> str:
    head, *others = map(markdown_row, rows)
    return "\n".join((head, f"|{'---|' * len(rows[0])}", *others))


def _told(page: Path, path: Path) -> str:
    if not path.is_file():
        raise InputError(f"{page}: asks for {path}, which is not there (tsbench analyse {path.stem} makes it)")
    return path.read_text(encoding="utf-8")


def _table(page: Path, told: str, words: list[str]) -> str:
    rows = [line[2:-2].split(" | ") for line in told.splitlines() if line.startswith("| ")]
    rule = next(line[1:-1].split("|") for line in told.splitlines() if line.startswith("|---"))
    head, columns = rows[0], list(range(len(rows[0])))
    lines_after: list[str] = []
    for word in words:
        if word == "bare":
            rows = [rows[0], *([_INTERVAL.sub("", cell) for cell in row] for row in rows[1:])]
            columns = [i for i in columns if head[i] not in _BESIDE]
        elif word == "contract":
            found = _CONTRACT.findall(told)
            if not found:
                raise InputError(f"{page}: {told.splitlines()[0]} names no contract")
            lines_after = ["", f"{found[-1]}."]
        elif word.startswith("where "):
            name, _, wanted_cell = (part.strip() for part in word.removeprefix("where ").partition("="))
            rows = [rows[0], *(row for row in rows[1:] if row[_place(page, head, name)] == wanted_cell)]
        elif word.startswith("planners "):
            # A floor's name is followed by what it is.
            wanted = [name.strip() for name in word.removeprefix("planners ").split(",")]
            named = _place(page, head, "planner")
            if absent := sorted(set(wanted) - {row[named].split(" (")[0] for row in rows[1:]}):
                raise InputError(f"{page}: no row of planner {', '.join(absent)}")
            rows = [rows[0], *(row for row in rows[1:] if row[named].split(" (")[0] in wanted)]
        elif word.startswith("columns "):
            asked = [name.strip() for name in word.removeprefix("columns ").split(",")]
            # A selection of fewer groups has no columns of the others.
            columns = [_place(page, head, name) for name in asked if name in head or name not in _BY_GROUP]
        else:
            raise InputError(
                f"{page}: {word!r} is none of: bare, contract, columns A, B, …, planners A, B, …, where A = x, csv NAME"
            )
    lines = [markdown_row(row[i] for i in columns) for row in rows]
    lines.insert(1, f"|{'|'.join(rule[i] for i in columns)}|")
    return "\n".join([*lines, *lines_after])


def _csv(table: str) -> str:
    """A Markdown table as CSV. A column with intervals becomes three: the value, `_low` and `_high`."""
    cells = [line[2:-2].split(" | ") for line in table.splitlines() if line.startswith("| ")]
    plain = [[html.unescape(re.sub(r"\\(.)", r"\1", cell)) for cell in row] for row in cells]
    columns = []
    for head, *column in zip(*plain, strict=True):
        parts = [_VALUE.fullmatch(cell) for cell in column]
        if any(parts):
            split = [part.groups() if part else (cell, "", "") for cell, part in zip(column, parts, strict=True)]
            columns += [list(c) for c in zip((head, f"{head}_low", f"{head}_high"), *split, strict=True)]
        else:
            columns.append([head, *column])
    return csv_text(zip(*columns, strict=True))


def _place(page: Path, head: list[str], name: str) -> int:
    if name not in head:
        raise InputError(f"{page}: no column {name!r}; there are {', '.join(head)}")
    return head.index(name)
