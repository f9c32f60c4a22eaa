"""An analysis: a table of typed cells, notes, perhaps a figure; printed in the terminal, and written to files.

Files are Markdown, a LaTeX float, CSV, and PNG and SVG where there is a figure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich import box
from rich.cells import cell_len
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.text import csv_text
from tsbench.run.edition import contract_line
from tsbench.scenarios.data_set import DataSet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tsbench.metrics.intervals import Estimate
    from tsbench.metrics.paired_differences import Difference

# The panel of all types, beside one for each group.
ALL = "all types"


class Kind(StrEnum):
    TEXT = "text"  # str
    COUNT = "count"  # int
    NUMBER = "number"  # float
    P = "p"  # float, a probability of a test
    VALUE = "value"  # Value


@dataclass(frozen=True, slots=True)
class Value:
    """A figure with its interval and its basis; None where it does not exist, and then `reason` says why.

    n: episodes, pairs or planners that count; None where it is not known. mark: put behind it, "*" for significant.
    """

    value: float | None
    low: float | None = None
    high: float | None = None
    n: int | None = None
    reason: str = ""
    mark: str = ""

    @classmethod
    def of(cls, figure: Estimate | Difference | None) -> Value | None:
        return None if figure is None else cls(figure.value, figure.low, figure.high, figure.n, figure.reason)

    @classmethod
    def difference(cls, figure: Difference) -> Value:
        return cls(figure.value, figure.low, figure.high, figure.n, figure.reason, "*" if figure.significant else "")


Cell = str | int | float | Value | None


@dataclass(frozen=True, slots=True)
class Column:
    """A column. key: its name in CSV; head: what readers see, with the unit; decimals: of what they see.

    signed: values above 0 show their sign.
    """

    key: str
    head: str
    kind: Kind = Kind.VALUE
    decimals: int = 1
    signed: bool = False


@dataclass(frozen=True, slots=True)
class Row:
    """Cells in the order of the columns. starts: a new block begins here; faint: a second reading of the row above."""

    cells: tuple[Cell, ...]
    starts: bool = False
    faint: bool = False


@dataclass(frozen=True)
class Table:
    """Rows under columns. fixed: so many first columns name the row; what does not fit beside them stands below.

    abreast: so many of the others fit on a page of paper.
    """

    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    fixed: int
    abreast: int = 12

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row.cells) != len(self.columns):
                raise ValueError(f"{len(row.cells)} cells under {len(self.columns)} columns: {row.cells}")


@dataclass(frozen=True)
class Analysis:
    """One analysis. name: of its files. title: one line, begins with PARTIAL where records are missing.

    contract: the hash that every score in it stands under; "" for a table without scores. draw: makes the figure; None
    where it is a table only. stacked: makes it with its panels one below the other, narrow enough for a telephone; None
    where it is narrow as it is. data: what it is of.
    """

    name: str
    title: str
    contract: str
    table: Table
    notes: tuple[str, ...]
    draw: Callable[[], Figure] | None = None
    stacked: Callable[[], Figure] | None = None
    data: DataSet = field(default_factory=DataSet)

    @property
    def contract_line(self) -> str:
        return contract_line(self.contract, self.data) if self.contract else ""


DASH = "–"
# Texts are folded where there is no room, but not to less than this.
_LEAST = 8
# Between columns: padding, and the box's own blank.
_PAD = 1
_GAP = _PAD + 1


def print_analysis(analysis: Analysis, console: Console) -> None:
    partial = analysis.title.startswith(("PARTIAL", "FORCED"))
    console.print(Text(analysis.title, style="bold yellow" if partial else "bold"))
    for block in _printed_blocks(analysis.table, console.width):
        console.print(_rich(analysis.table, block, console.width))
    for line in (*analysis.notes, analysis.contract_line):
        if line:
            # A hash is copied, so it stays whole.
            console.print(Text(line, style="dim"), soft_wrap="contract " in line)


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


def _printed_blocks(table: Table, width: int) -> list[tuple[int, ...]]:
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
        cells = (Text("\n".join(lines_of(table.columns[k], row.cells[k]))) for k in block)
        shown.add_row(*cells, style="dim" if row.faint else None)
    return shown


def to_markdown(analysis: Analysis) -> str:
    columns = analysis.table.columns
    lines = [f"**{_escape(analysis.title)}**", ""]
    lines.append(markdown_row(_escape(" ".join(column.head.split("\n"))) for column in columns))
    lines.append("|" + "|".join("---" if column.kind is Kind.TEXT else "---:" for column in columns) + "|")
    for row in analysis.table.rows:
        lines.append(
            markdown_row(_cell(lines_of(column, cell)) for column, cell in zip(columns, row.cells, strict=True))
        )
    return "\n".join([*lines, "", *markdown_notes(analysis), ""])


def markdown_notes(analysis: Analysis) -> list[str]:
    """Lines below a table, the contract last."""
    notes = [_escape(note) for note in analysis.notes if note]
    if analysis.contract:
        notes.append(f"Contract `{analysis.contract}`")
    return [f"{note.removesuffix('.')}." for note in notes]


def markdown_row(cells: Iterable[str]) -> str:
    """A line of a table; bars within cells stay text."""
    return "| " + " | ".join(cell.replace("|", "&#124;") for cell in cells) + " |"


def _cell(lines: Sequence[str]) -> str:
    first, *rest = (_escape(line) for line in lines)
    return f"{first} ({' '.join(rest)})" if rest else first


def _escape(text: str) -> str:
    return "".join(f"\\{letter}" if letter in "\\`*_<>[]" else letter for letter in text)


_COMMANDS = {"\\": "backslash", "~": "asciitilde", "^": "asciicircum", "<": "less", ">": "greater", "|": "bar"}
_SPECIAL = {
    **{mark: rf"\text{name}{{}}" for mark, name in _COMMANDS.items()},
    **{mark: f"\\{mark}" for mark in "{}$&#%_"},
    **{"–": "--", "±": r"$\pm$", "ρ": r"$\rho$", "×": r"$\times$", "\n": " "},
}


def escape(text: str) -> str:
    """Text that LaTeX prints as it is."""
    return "".join(_SPECIAL.get(letter, letter) for letter in text)


def to_latex(analysis: Analysis) -> str:
    """The float: caption with the title, the table in as many parts as it is printed in, notes, contract."""
    lines = [
        "% Needs \\usepackage{booktabs}; names that are not ASCII need XeLaTeX or LuaLaTeX.",
        r"\begin{table*}",
        r"\centering\scriptsize\setlength{\tabcolsep}{3pt}",
        rf"\caption{{{escape(analysis.title)}.}}",
        rf"\label{{tab:tsbench-{analysis.name}}}",
    ]
    for k, block in enumerate(_latex_blocks(analysis.table)):
        lines += [r"\par\medskip"] if k else []
        lines += _tabular(analysis.table, block)
    for note in (*analysis.notes, analysis.contract_line):
        if note:
            lines += [rf"\par\smallskip\parbox{{\linewidth}}{{{escape(note)}.}}"]
    return "\n".join([*lines, r"\end{table*}", ""])


def _latex_blocks(table: Table) -> list[tuple[int, ...]]:
    """Columns (by number) of the parts that stand below each other, as even as can be."""
    others = range(table.fixed, len(table.columns))
    parts = max(-(-len(others) // table.abreast), 1)
    wide = -(-len(others) // parts)
    return [(*range(table.fixed), *others[k * wide : (k + 1) * wide]) for k in range(parts)]


def _tabular(table: Table, block: tuple[int, ...]) -> list[str]:
    columns = [table.columns[k] for k in block]
    letters = "".join("l" if column.kind is Kind.TEXT else "r" for column in columns)
    heads = " & ".join(_stacked(column.head.split("\n")) for column in columns)
    lines = [rf"\begin{{tabular}}{{{letters}}}", r"\toprule", heads + r" \\", r"\midrule"]
    for number, row in enumerate(table.rows):
        if row.starts and number:
            lines.append(r"\midrule")
        cells = [_stacked(lines_of(table.columns[k], row.cells[k]), r"\tiny ") for k in block]
        lines.append(" & ".join(cells) + r" \\")
    return [*lines, r"\bottomrule", r"\end{tabular}"]


def _stacked(lines: Sequence[str], below: str = "") -> str:
    first, *rest = (escape(line) for line in lines)
    if not rest:
        return first
    return rf"\shortstack[r]{{{first}\\{{{below}{' '.join(rest)}}}}}"


_DIGITS = 6


def write_analysis(analysis: Analysis, folder: Path) -> list[Path]:
    """Write all files and return their paths. The same analysis gives the same bytes. Raises InputError."""
    texts = {"csv": to_csv(analysis), "tex": to_latex(analysis), "md": to_markdown(analysis)}
    paths = []
    for suffix, text in texts.items():
        path = folder / f"{analysis.name}.{suffix}"
        with io_errors_as_input_errors(path):
            write_atomic(path, text.encode())
        paths.append(path)
    if analysis.draw is not None:
        from tsbench.report.charts import save_chart  # brings matplotlib

        pictures = [folder / f"{analysis.name}.{suffix}" for suffix in ("png", "svg")]
        save_chart(analysis.draw, *pictures)
        paths += pictures
    return paths


def to_csv(analysis: Analysis) -> str:
    """One line per row. A value takes four columns: itself, `_low`, `_high`, `_n`; title and contract in each line."""
    columns, scored = analysis.table.columns, bool(analysis.contract)
    heads = [(c.key, *(f"{c.key}_{part}" for part in ("low", "high", "n") if c.kind is Kind.VALUE)) for c in columns]
    lines = [[*chain.from_iterable(heads), "title", *["contract"] * scored]]
    for row in analysis.table.rows:
        cells = [part for column, cell in zip(columns, row.cells, strict=True) for part in _csv_parts(column, cell)]
        lines.append([*cells, analysis.title, *[analysis.contract] * scored])
    return csv_text(lines)


def _csv_parts(column: Column, cell: Cell) -> Iterator[str]:
    value = cell if isinstance(cell, Value) else Value(None)
    parts = (value.value, value.low, value.high, value.n) if column.kind is Kind.VALUE else (cell,)
    return map(_plain, parts)


def _plain(cell: Cell) -> str:
    if cell is None:
        return ""
    return repr(round(cell, _DIGITS)) if isinstance(cell, float) else str(cell)
