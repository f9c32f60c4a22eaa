"""Analyses as tables: right figures, each with what it rests on; LaTeX and CSV that hold any name."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from scipy.stats import rankdata

from tsbench.report.analyses.analysis import (
    ALL,
    Analysis,
    Column,
    Kind,
    Row,
    Table,
    Value,
    escape,
    lines_of,
    to_csv,
    to_latex,
    to_markdown,
    write_analysis,
)
from tsbench.report.analyses.columns import (
    in_published_order,
    published,
    published_metric,
    published_scd,
    without_experts,
)
from tsbench.report.analyses.scd_statistics import spearman

HOSTILE = r"50%_of {my}\planner & <b>$x^2$ #1|~"


def small(title: str = "A title", abreast: int = 12) -> Analysis:
    columns = (
        Column("planner", "planner", Kind.TEXT), Column("scd", "SCD\n%"), Column("n", "n", Kind.COUNT),
        Column("p", "p", Kind.P),
    )  # fmt: skip
    rows = (
        Row((HOSTILE, Value(12.345, 10.0, 15.0, 40), 40, 0.0004), starts=True),
        Row(("idm", Value(-0.04, -1.0, 1.0, 3), 3, 0.25), starts=True),
        Row(("idm", Value(None, n=0, reason="no episode"), 0, None), faint=True),
    )
    return Analysis("small", title, "c0ffee", Table(columns, rows, 1, abreast), ("a note",))


def test_spearman_as_published() -> None:
    # Wikipedia, "Spearman's rank correlation coefficient": IQ and hours of television of ten people, rho = -29/165.
    iq = [106.0, 100.0, 86.0, 101.0, 99.0, 103.0, 97.0, 113.0, 112.0, 110.0]
    hours = [7.0, 27.0, 2.0, 50.0, 28.0, 29.0, 20.0, 12.0, 6.0, 17.0]
    found = spearman(iq, hours)
    assert (found.value, found.n) == (pytest.approx(-29 / 165), 10)
    # Bonett and Wright (2000): z +- 1.96 sqrt((1 + r^2 / 2) / (n - 3)), worked by hand.
    assert (found.low, found.high) == (pytest.approx(-0.7278, abs=1e-4), pytest.approx(0.5146, abs=1e-4))


def test_spearman_s_interval_covers_the_truth() -> None:
    """Normal pairs of which Spearman's rho is 0.6: 95 % intervals of 17 points hold it about 95 times in 100."""
    rng, held = np.random.default_rng(11), 0
    pearson = 2 * np.sin(np.pi * 0.6 / 6)
    for _ in range(400):
        x, y = rng.multivariate_normal([0, 0], [[1, pearson], [pearson, 1]], 17).T
        found = spearman(x.tolist(), y.tolist())
        assert found.high is not None
        held += found.low <= 0.6 <= found.high
    assert 0.91 <= held / 400 <= 0.99


@pytest.mark.parametrize(
    ("metric", "rho"), [("driving_score", -0.19), ("destination", -0.23), ("efficiency", -0.76), ("collision", -0.91)]
)
def test_spearman_of_the_study_s_nine_planners(metric: str, rho: float) -> None:
    nine = without_experts()
    values = [published_metric(name, metric) for name in nine]
    scd = [published_scd(name, ALL) for name in nine]
    by_ranks = np.corrcoef(rankdata(values), rankdata(scd))[0, 1]
    assert spearman(values, scd).value == pytest.approx(by_ranks)
    assert (spearman(values, scd).value, spearman(values, scd).n) == (pytest.approx(rho, abs=5e-3), 9)


def test_spearman_says_why_there_is_nothing() -> None:
    assert spearman([1.0, 2.0, None], [1.0, 2.0, 3.0]) == Value(None, n=2, reason="fewer than 3 planners")
    assert spearman([1.0, 1.0, 1.0], [1.0, 2.0, 3.0]).reason == "the same for all planners"
    four = spearman([1.0, 2.0, 3.0, 4.0], [1.0, 2.0, 4.0, 3.0])
    assert (four.value, four.low) == (pytest.approx(0.8), None)
    assert "fewer than 5 planners" in four.reason
    whole = spearman(range(8), range(8))
    assert (whole.value, whole.low, whole.reason) == (pytest.approx(1.0), None, "ranks agree wholly: no interval")


def test_the_published_table_is_whole() -> None:
    assert len(published()) == 17
    assert (published_scd("plant2-ft", ALL), published_scd("idm", "priority")) == (72.3, 14.6)
    assert (published_metric("idm", "collision"), published_metric("idm", "comfort")) == (21.0, None)
    assert published_scd("mine", ALL) is None
    assert in_published_order(["zoo", "ppo", "alpha", "idm"]) == ("idm", "ppo", "alpha", "zoo")


def test_csv_has_ends_n_title_and_contract_in_each_row() -> None:
    text = to_csv(small())
    rows = list(csv.DictReader(io.StringIO(text)))
    assert text.splitlines()[0] == "planner,scd,scd_low,scd_high,scd_n,n,p,title,contract"
    assert rows[0]["planner"] == HOSTILE
    assert [rows[0][key] for key in ("scd", "scd_low", "scd_high", "scd_n")] == ["12.345", "10.0", "15.0", "40"]
    assert [rows[2][key] for key in ("scd", "scd_low", "scd_n", "p")] == ["", "", "0", ""]
    assert {(row["title"], row["contract"]) for row in rows} == {("A title", "c0ffee")}


def test_latex_prints_any_name() -> None:
    text = to_latex(small(HOSTILE))
    for letter in "%_&#$":
        for k in (k for k, c in enumerate(text) if c == letter):
            line = text[: k + 1].splitlines()[-1]
            assert line.endswith(f"\\{letter}") or letter == "&" or line == "%", line
    # \\{ is a line break and a group, \{ is a brace that is printed.
    groups = text.replace("\\\\", "").replace(r"\{", "").replace(r"\}", "")
    assert groups.count("{") == groups.count("}")
    body = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert {line.replace(r"\&", "").count("&") for line in body} == {3}
    assert escape(HOSTILE) in text
    assert r"\shortstack[r]{12.3\\{\tiny 10.0--15.0}}" in text
    assert "contract c0ffee" in text
    assert "a note." in text


def test_latex_sets_what_is_too_wide_below() -> None:
    text = to_latex(small(abreast=2))
    assert text.count(r"\begin{tabular}") == 2
    assert text.count(r"planner & ") == 2


def test_markdown_shows_any_name_as_text() -> None:
    lines = to_markdown(small("a|b *c* <b>")).splitlines()
    table = [line for line in lines if line.startswith("|")]
    assert {line.count("|") for line in table} == {5}
    assert "12.3 (10.0–15.0)" in table[2]
    assert lines[0] == r"**a|b \*c\* \<b\>**"
    assert lines[-2:] == ["a note.", "Contract `c0ffee`."]


@pytest.mark.parametrize(
    ("kind", "cell", "lines"),
    [
        (Kind.VALUE, Value(1.25, -0.5, 3.0, 9), ("1.2", "-0.5 to 3.0")),
        (Kind.VALUE, Value(-0.01), ("0.0",)),
        (Kind.VALUE, Value(None), ("–",)),
        (Kind.VALUE, None, ("–",)),
        (Kind.P, 0.0001, ("<0.001",)),
        (Kind.NUMBER, None, ("–",)),
        (Kind.TEXT, None, ("",)),
        (Kind.COUNT, 12, ("12",)),
    ],
)
def test_cells_as_readers_see_them(kind: Kind, cell: object, lines: tuple[str, ...]) -> None:
    assert lines_of(Column("x", "x", kind), cell) == lines


def test_a_row_must_fill_its_columns() -> None:
    with pytest.raises(ValueError, match="1 cells under 2 columns"):
        Table((Column("a", "a"), Column("b", "b")), (Row((1.0,)),), 1)


def test_files_of_a_table_without_a_figure(tmp_path) -> None:
    paths = write_analysis(small(), tmp_path / "new")
    assert [path.name for path in paths] == ["small.csv", "small.tex", "small.md"]
    assert {p.name for p in (tmp_path / "new").iterdir()} == {p.name for p in paths}
