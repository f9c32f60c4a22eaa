"""Cells as readers see them: in the terminal, and in LaTeX."""

from __future__ import annotations

from typing import Literal

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from tsbench.report.analyses.model import Analysis, Cell, Column, Kind, Table, Value

DASH = "–"
# Two lines in a cell: the value, below it the ends of its interval.
_BREAK = "\n"
# Texts are folded where there is no room, but not to less than this.
_LEAST = 8
# Between columns: padding, and the box's own blank.
_PAD = 1
_GAP = _PAD + 1


def print_analysis(analysis: Analysis, console: Console) -> None:
    console.print(Text(analysis.title, style="bold yellow" if is_partial(analysis) else "bold"))
    for block in _blocks(analysis.table, console.width):
        console.print(_rich(analysis.table, block, console.width))
    for line in (*analysis.notes, analysis.contract_line):
        if line:
            # A hash is copied, so it stays whole.
            console.print(Text(line, style="dim"), soft_wrap="contract " in line)


def is_partial(analysis: Analysis) -> bool:
    """Does the title say that records are missing, or that what was compared should not be?"""
    return analysis.title.startswith(("PARTIAL", "FORCED"))


def lines_of(column: Column, cell: Cell) -> tuple[str, ...]:
    """A cell as one or two lines of plain text."""
    if isinstance(cell, Value):
        if cell.value is None:
            return (DASH,)
        first = _number(cell.value, column.decimals) + cell.mark
        if column.signed and not first.startswith("-"):
            first = f"+{first}"
        if cell.low is None or cell.high is None:
            return (first,)
        low, high = (_number(end, column.decimals) for end in (cell.low, cell.high))
        # A minus sign beside the dash between the ends would be hard to read.
        between = " to " if "-" in low + high else DASH
        return first, f"{low}{between}{high}"
    if cell is None:
        return ("" if column.kind is Kind.TEXT else DASH,)
    if isinstance(cell, float):
        if column.kind is Kind.P:
            return ("<0.001" if cell < 0.001 else f"{cell:.3f}",)
        return (_number(cell, column.decimals),)
    return (str(cell),)


def _number(value: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def _blocks(table: Table, width: int) -> list[tuple[int, ...]]:
    """Columns (by number) of the parts that are printed below each other."""
    wide = [_width(table, k) + _GAP for k in range(len(table.columns))]
    fixed = tuple(range(table.fixed))
    blocks: list[tuple[int, ...]] = [fixed]
    for k in range(table.fixed, len(table.columns)):
        if len(blocks[-1]) > table.fixed and sum(wide[j] for j in (*blocks[-1], k)) - _GAP > width:
            blocks.append(fixed)
        blocks[-1] += (k,)
    return blocks


def _width(table: Table, k: int) -> int:
    column = table.columns[k]
    lines = [*column.head.split("\n"), *(x for row in table.rows for x in lines_of(column, row.cells[k]))]
    return max(cell_len(line) for line in lines)


def _fitted(table: Table, block: tuple[int, ...], width: int) -> list[int]:
    """Widths of a part's columns: those that they need, the widest texts narrower where there is no room."""
    fitted = [_width(table, k) for k in block]
    texts = [at for at, k in enumerate(block) if table.columns[k].kind is Kind.TEXT]
    while sum(fitted) + _GAP * (len(block) - 1) > width:
        widest = max(texts, key=fitted.__getitem__, default=-1)
        if widest < 0 or fitted[widest] <= _LEAST:
            break
        fitted[widest] -= 1
    return fitted


def _rich(table: Table, block: tuple[int, ...], width: int) -> RichTable:
    shown = RichTable(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, _PAD, 0, 0))
    for k, room in zip(block, _fitted(table, block, width), strict=True):
        column = table.columns[k]
        side: Literal["left", "right"] = "left" if column.kind is Kind.TEXT else "right"
        shown.add_column(Text(column.head), justify=side, overflow="fold", min_width=room, max_width=room)
    for row in table.rows:
        if row.starts and shown.row_count:
            shown.add_section()
        cells = (Text(_BREAK.join(lines_of(table.columns[k], row.cells[k]))) for k in block)
        shown.add_row(*cells, style="dim" if row.faint else None)
    return shown
