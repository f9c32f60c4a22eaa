"""An analysis as files: Markdown, a LaTeX float, CSV, and PNG and SVG where there is a figure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.core.text import csv_text
from tsbench.report.analyses.model import Analysis, Cell, Column, Kind, Table, Value
from tsbench.report.analyses.shown import lines_of


def to_markdown(analysis: Analysis) -> str:
    columns = analysis.table.columns
    lines = [f"**{_escape(analysis.title)}**", ""]
    lines.append(markdown_row(_escape(" ".join(column.head.split("\n"))) for column in columns))
    lines.append("|" + "|".join("---" if column.kind is Kind.TEXT else "---:" for column in columns) + "|")
    for row in analysis.table.rows:
        lines.append(
            markdown_row(
                _cell(lines_of(column, cell)) for column, cell in zip(columns, row.cells, strict=True)
            )
        )
    notes = [_escape(note) for note in analysis.notes if note]
    if analysis.contract:
        notes.append(f"Contract `{analysis.contract}`")
    return "\n".join([*lines, "", *(f"{note.removesuffix('.')}." for note in notes), ""])


def markdown_row(cells: Iterable[str]) -> str:
    """A line of a table; bars within cells stay text."""
    return "| " + " | ".join(cell.replace("|", "&#124;") for cell in cells) + " |"


def _cell(lines: Sequence[str]) -> str:
    first, *rest = (_escape(line) for line in lines)
    return f"{first} ({' '.join(rest)})" if rest else first


def _escape(text: str) -> str:
    return "".join(f"\\{letter}" if letter in "\\`*_<>[]" else letter for letter in text)


_SPECIAL = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "$": r"\$", "&": r"\&", "#": r"\#", "%": r"\%", "_": r"\_",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "|": r"\textbar{}", "–": "--", "±": r"$\pm$", "ρ": r"$\rho$", "×": r"$\times$", "\n": " ",
}  # fmt: skip


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
    for k, block in enumerate(_blocks(analysis.table)):
        lines += [r"\par\medskip"] if k else []
        lines += _tabular(analysis.table, block)
    for note in (*analysis.notes, analysis.contract_line):
        if note:
            lines += [rf"\par\smallskip\parbox{{\linewidth}}{{{escape(note)}.}}"]
    return "\n".join([*lines, r"\end{table*}", ""])


def _blocks(table: Table) -> list[tuple[int, ...]]:
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
        from tsbench.report.tables.charts import save_chart  # brings matplotlib

        pictures = [folder / f"{analysis.name}.{suffix}" for suffix in ("png", "svg")]
        save_chart(analysis.draw, *pictures)
        paths += pictures
    return paths


def to_csv(analysis: Analysis) -> str:
    """One line per row. A value takes four columns: itself, `_low`, `_high`, `_n`; title and contract in each line."""
    columns, scored = analysis.table.columns, bool(analysis.contract)
    lines = [[*(head for column in columns for head in _heads(column)), "title", *["contract"] * scored]]
    for row in analysis.table.rows:
        cells = [
            part for column, cell in zip(columns, row.cells, strict=True) for part in _parts(column, cell)
        ]
        lines.append([*cells, analysis.title, *[analysis.contract] * scored])
    return csv_text(lines)


def _heads(column: Column) -> Iterator[str]:
    yield column.key
    if column.kind is Kind.VALUE:
        yield from (f"{column.key}_{part}" for part in ("low", "high", "n"))


def _parts(column: Column, cell: Cell) -> Iterator[str]:
    if column.kind is not Kind.VALUE:
        yield _plain(cell)
        return
    value = cell if isinstance(cell, Value) else Value(None)
    yield from (_plain(part) for part in (value.value, value.low, value.high, value.n))


def _plain(cell: Cell) -> str:
    if cell is None:
        return ""
    return repr(round(cell, _DIGITS)) if isinstance(cell, float) else str(cell)
