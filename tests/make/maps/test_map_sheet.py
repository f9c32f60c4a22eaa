"""Maps of the pool as one picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_crop import rows_of

from tsbench.make.maps.map_sheet import map_sheet
from tsbench.make.maps.source import SourceNetwork
from tsbench.report.drawing.canvas import STYLE
from tsbench.report.drawing.paint import save_png


@pytest.mark.parametrize(("family", "marked"), [("junction", False), ("corridor", True)])
def test_a_sheet_shows_roads_and_what_the_family_marks(
    tiny: SourceNetwork, tmp_path: Path, family: str, marked: bool
) -> None:
    rows = rows_of(tiny, family)[:7]
    page = map_sheet([(row, tiny) for row in rows])
    save_png(tmp_path / "sheet.png", page)
    columns = min(len(rows), 5)
    assert page.shape[1] > 300 * columns
    assert page.shape[0] > 280 * -(-len(rows) // columns)
    for colour in (STYLE.asphalt, STYLE.ground, STYLE.panel):
        assert (page == colour).all(axis=2).sum() > 1000, colour
    # A corridor's edge is tinted: bluer than its road; a junction has none.
    tinted = np.array(STYLE.route) * 0.8 + np.array(STYLE.asphalt) * 0.2
    assert ((np.abs(page - tinted).max(axis=2) < 3).sum() > 100 * len(rows)) is np.bool_(marked)
