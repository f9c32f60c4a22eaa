"""Pages of scenario types, from the committed scenarios."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from PIL import Image as PilImage
from scripts import load_script

from tsbench.core.errors import InputError
from tsbench.report.wording import OPTIONS, THRESHOLDS, in_values, threshold_value
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog

PageMaker = load_script("sign_pages").PageMaker


def test_a_page_shows_law_rule_violation_and_pass(tmp_path: Path) -> None:
    maker = PageMaker(DataSet(), tmp_path)
    text = maker.write("speed_limit").read_text(encoding="utf-8")
    for words in (
        "3.24",
        "3.25",
        "Vienna",
        "| tolerance | 1 km/h | `tolerance_kmh` |",
        "above the limit plus 1 km/h inside the zone",
        "`over_limit`",
        "| `idm` breaks the rule | `idm-e` obeys",
        "## The other half",
        "| `idm-e` | the same commands as in the first half |",
    ):
        assert words in text
    assert "> From " in text  # the sentence of the violation
    for name in (f"speed_limit-{part}.gif" for part in ("violation", "pass", "contrast", "repeated")):
        with PilImage.open(tmp_path / "pictures" / name) as film:
            assert getattr(film, "n_frames", 1) >= 12
            assert film.size == (480, 420)
        assert (tmp_path / "pictures" / name).stat().st_size < 250_000
    with PilImage.open(tmp_path / "pictures" / "speed_limit.png") as picture:
        assert picture.width > 1000
    with PilImage.open(tmp_path / "pictures" / "speed_limit-violation.gif") as film:
        held = []
        for k in range(getattr(film, "n_frames", 1)):
            film.seek(k)
            held.append(film.info["duration"])
    # The moment of the violation is held, and so is the end.
    assert sorted(held)[-2:] == [1500, 2500]
    assert held[-1] == 1500
    index = maker.write_index().read_text(encoding="utf-8")
    assert index.count("](speed_limit.md)") == 1
    plates = re.findall(r'<img src="([^"]+)"', text + index)
    assert len(plates) == 4
    for name in plates:
        assert "<text" not in (tmp_path / name).read_text(encoding="utf-8")  # the number is drawn


def test_every_threshold_and_option_has_words_and_values_their_units() -> None:
    catalog = load_catalog()
    rules = [catalog.sign(code).rule for kind in catalog.types for code in kind.codes]
    assert {key for rule in rules for key in rule.thresholds} == set(THRESHOLDS)
    assert {key for rule in rules for key in rule.options} == set(OPTIONS)
    assert [threshold_value(k, v) for k, v in (("a_mps2", 2.5), ("b_mps", 2.0), ("c_ratio", 0.3), ("d_deg", 35.0))] == [
        "2.5 m/s²", "2 m/s", "30 %", "35°",
    ]  # fmt: skip
    assert in_values("within gap_s, not leader_gap_s", {"gap_s": 4.0}) == "within 4 s, not leader_gap_s"


def test_a_type_without_scenarios_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="fly"):
        PageMaker(DataSet(), tmp_path).write("fly")
