"""Writes an analysis: NAME.csv, NAME.tex and NAME.md, and NAME.png and NAME.svg where there is a figure."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path

from tsbench.core.files import io_errors_as_input_errors, write_atomic
from tsbench.report.analyses.latex import to_latex
from tsbench.report.analyses.markdown import to_markdown
from tsbench.report.analyses.model import Analysis, Cell, Column, Kind, Value

_DIGITS = 6


def write_analysis(analysis: Analysis, folder: Path) -> list[Path]:
    """Write all files and return their paths. The same analysis gives the same bytes. Raises InputError."""
    texts = {"csv": to_csv(analysis), "tex": to_latex(analysis), "md": to_markdown(analysis)}
    paths = []
    for suffix, text in texts.items():
        path = folder / f"{analysis.name}.{suffix}"
        with io_errors_as_input_errors(path):
            path.parent.mkdir(parents=True, exist_ok=True)
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
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    columns, scored = analysis.table.columns, bool(analysis.contract)
    heads = [head for column in columns for head in _heads(column)]
    writer.writerow([*heads, "title", *(["contract"] if scored else [])])
    for row in analysis.table.rows:
        cells = [
            part for column, cell in zip(columns, row.cells, strict=True) for part in _parts(column, cell)
        ]
        writer.writerow([*cells, analysis.title, *([analysis.contract] if scored else [])])
    return text.getvalue()


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
