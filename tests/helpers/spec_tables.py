"""Reads the tables of the reference pages, so that tests can compare them with data and code."""

from __future__ import annotations

import re
from pathlib import Path

import tsbench

ROOT = Path(tsbench.__file__).parents[1]
DOCS = ROOT / "docs"

Row = dict[str, str]


def headings(text: str) -> list[str]:
    """The titles of a page, without the text of code blocks."""
    shown = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    return [title.strip() for title in re.findall(r"^#+ +(.+)$", shown, flags=re.M)]


def tables(page: str) -> list[list[Row]]:
    """All tables of a page: rows as dicts by the heads of their columns, marks (** and `) taken away."""
    found: list[list[Row]] = []
    head: list[str] = []
    for line in [*(DOCS / page).read_text(encoding="utf-8").splitlines(), ""]:
        if not line.startswith("|"):
            head = []
            continue
        cells = [cell.strip() for cell in line.replace("`", "").replace("**", "").strip("|").split("|")]
        if not head:
            head = cells
            found.append([])
        elif not set(line) <= set("|-: "):
            found[-1].append(dict(zip(head, cells, strict=True)))
    return found


def table(page: str, *columns: str) -> list[Row]:
    """The one table of a page that has these columns, whatever else it has."""
    fitting = [rows for rows in tables(page) if rows and set(columns) <= set(rows[0])]
    assert len(fitting) == 1, f"{page}: {len(fitting)} tables with the columns {columns}"
    return fitting[0]


def words(cell: str) -> list[str]:
    """What a cell lists, by commas."""
    return [word.strip() for word in cell.split(",") if word.strip()]


def numbers(cell: str) -> list[float]:
    """The numbers in a cell, in order; "10-20" are two."""
    return [float(number) for number in re.findall(r"(?<![\w.])-?\d+(?:\.\d+)?", re.sub(r"(?<=\d)-", " ", cell))]
