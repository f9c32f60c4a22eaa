"""The table of figures as a terminal shows it: pandas alone would leave out the columns in the middle, and so SCD."""

from __future__ import annotations

import pandas as pd

_SHOWN = ["planner", "figure", "reading", "value", "low", "high", "n"]


class Figures(pd.DataFrame):
    """A pandas table whose text is the overall figures, each with its interval; what is taken from it is plain."""

    @property
    def _constructor(self) -> type[pd.DataFrame]:
        return pd.DataFrame

    def __repr__(self) -> str:
        if not {*_SHOWN, "over"} <= set(self.columns):
            return super().__repr__()
        overall = pd.DataFrame(self[self["over"] == "all"])
        shown = overall[_SHOWN].astype(dict.fromkeys(("value", "low", "high"), float))
        if shown["reading"].nunique() < 2:
            shown = shown.drop(columns="reading")
        text = shown.to_string(index=False, float_format=lambda number: f"{number:.1f}", na_rep="-")
        return (
            f"{text}\n"
            f"{len(self) - len(overall)} more rows: by group and type. low, high: the 95 % interval.\n"
            f"Columns: {', '.join(map(str, self.columns[:6]))},\n{', '.join(map(str, self.columns[6:]))}"
        )

    def __str__(self) -> str:
        return repr(self)
