"""What an analysis is made of: a table of typed cells, notes, and perhaps a figure. Nothing here writes anything."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from tsbench.run.edition import edition_of

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
    """A figure with its interval and what it rests on; None where there is none, and then `reason` says why.

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
        return cls(
            figure.value, figure.low, figure.high, figure.n, figure.reason, "*" if figure.significant else ""
        )


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
    where it is narrow as it is.
    """

    name: str
    title: str
    contract: str
    table: Table
    notes: tuple[str, ...]
    draw: Callable[[], Figure] | None = None
    stacked: Callable[[], Figure] | None = None

    @property
    def contract_line(self) -> str:
        return f"edition {edition_of(self.contract)}, contract {self.contract}" if self.contract else ""
