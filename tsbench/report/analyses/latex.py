"""A table as a LaTeX float. It needs the package booktabs, and a Unicode engine where names are not ASCII."""

from __future__ import annotations

from collections.abc import Sequence

from tsbench.report.analyses.model import Analysis, Kind, Table
from tsbench.report.analyses.shown import lines_of

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
    """One line as it is; two over each other, the second one smaller."""
    first, *rest = (escape(line) for line in lines)
    if not rest:
        return first
    return rf"\shortstack[r]{{{first}\\{{{below}{' '.join(rest)}}}}}"
