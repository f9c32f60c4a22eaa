"""A table as GitHub shows it: one line per row, an interval behind its value."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from tsbench.report.analyses.model import Analysis, Kind
from tsbench.report.analyses.shown import lines_of


def to_markdown(analysis: Analysis) -> str:
    """Title, table, notes, contract."""
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
    """Text in which nothing is markup."""
    return "".join(f"\\{letter}" if letter in "\\`*_<>[]" else letter for letter in text)
