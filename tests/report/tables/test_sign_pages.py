"""Pages of scenario types, from the committed scenarios."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image as PilImage

from tsbench.core.errors import InputError
from tsbench.report.tables.sign_pages import PageMaker


def test_a_page_shows_law_rule_violation_and_pass(tmp_path: Path) -> None:
    maker = PageMaker(tmp_path)
    text = maker.write("speed_limit").read_text(encoding="utf-8")
    for words in (
        "3.24",
        "3.25",
        "Vienna",
        "`tolerance_kmh` | 1 |",
        "`over_limit`",
        "| `idm` breaks the rule | `idm-e` obeys",
        "## The other half",
        "| `idm-e` | the same commands as in the first half |",
    ):
        assert words in text
    assert "> From " in text  # the sentence of the violation
    for name in (f"speed_limit-{part}.gif" for part in ("violation", "pass", "contrast", "repeated")):
        with PilImage.open(tmp_path / "pictures" / name) as film:
            assert getattr(film, "n_frames", 1) >= 20
        assert (tmp_path / "pictures" / name).stat().st_size < 250_000
    with PilImage.open(tmp_path / "pictures" / "speed_limit.png") as picture:
        assert picture.width > 1000
    index = maker.write_index().read_text(encoding="utf-8")
    assert index.count("](speed_limit.md)") == 1


def test_a_type_without_scenarios_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fly"):
        PageMaker(tmp_path).write("fly")
