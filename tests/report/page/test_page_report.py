"""`tsbench report`: figures of the summary, text that stays text, players within the bound, clear answers."""

from __future__ import annotations

import re
from collections.abc import Callable
from html import unescape
from pathlib import Path

import command_line
import page_runs
import pytest
import run_builders
from command_line import in_process
from forgeries import change_manifest
from page_runs import HOSTILE, TRACED

from tsbench.cli import main
from tsbench.episode.trace import trace_path
from tsbench.report.analyses.analysis import Analysis, Column, Kind, Row, Table, Value
from tsbench.report.analyses.run_pool import index_episodes, read_pool
from tsbench.report.page import report_page as embedding
from tsbench.report.page import report_sections
from tsbench.report.page.episode_player import EpisodePacker
from tsbench.report.page.report_page import NAME, Written, embed, write_report
from tsbench.report.page.report_sections import heading, headlines, sections, show

Reported = tuple[Path, Written, str]


@pytest.fixture(autouse=True)
def handmade_scenes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(embedding, "_packer", page_runs.packer)


@pytest.fixture
def no_charts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing is what takes time; the page of `reported` has all charts."""
    monkeypatch.setattr(report_sections, "inline_svg", lambda *_: "")


def write(run: Path, partial: bool = False) -> tuple[Written, str]:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(embedding, "_packer", page_runs.packer)
        done = write_report([run], None, allow_partial=partial, max_mb=20.0, workers=1, progress=lambda done, of: None)
    return done, done.path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Reported:
    """A run, one of its traces torn and one of an episode that it has not, and its page."""
    run = page_runs.make_run(tmp_path_factory.mktemp("reported") / "run")
    torn = trace_path(run, "idm", TRACED[1])
    torn.write_bytes(torn.read_bytes()[:400])
    page_runs.put_trace(run, "idm", "speed_limit-nowhere-v0")
    return run, *write(run)


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """The line with which the command refuses."""
    return lambda *arguments: command_line.refused(in_process("report", capsys), *map(str, arguments))


def test_the_page_holds_the_summarys_figures(reported: Reported) -> None:
    run, done, page = reported
    assert done.path == run / NAME
    assert (done.players, done.playable, done.episodes) == (3, 4, 96)
    assert done.size == done.path.stat().st_size
    summary = read_pool([run], False).summary
    text = unescape(re.sub(r"<[^>]+>", " ", page))
    for planner in summary.planners:
        e = planner.primary.overall.strict
        assert f"{e.value:.1f}" in text
        assert f"{e.low:.1f}–{e.high:.1f}" in text
    first = text.index("Summary", text.index("edition"))
    failed = [one["failed"] for one in headlines(read_pool([run], False))]
    assert len(failed) == len(summary.planners)
    assert all(0 < text.index(words) < first for words in failed), "above the tables"
    assert run_builders.CONTRACT in text
    figures = re.findall(r"<figure.*?</figure>", page, re.DOTALL)
    assert len(figures) == 4
    assert not any(run_builders.CONTRACT in figure for figure in figures)
    edition = f">edition {read_pool([run], False).edition}<"
    assert ["test split" in figure and edition in figure for figure in figures] == [True, False] * 2, "wide ones"
    assert "PARTIAL" not in text
    for head in ("Summary", "How sure", "By type", "Planners compared", "Failures", "Episodes"):
        assert f"<h2>{head}</h2>" in page


def test_the_page_asks_nobody_for_anything(reported: Reported) -> None:
    page = reported[2]
    outside = re.findall(r'(?:src|href|url|action)\s*[=(]\s*["\']?([a-z]+://[^"\')\s]+)', page)
    assert [u for u in outside if not u.startswith("http://www.w3.org/")] == []
    assert "default-src &#39;none&#39;" in page
    assert "connect-src" not in page


def test_hostile_names_are_text(reported: Reported) -> None:
    page = reported[2]
    assert HOSTILE not in page
    assert "<img src=x" not in page
    assert "&lt;img src=x onerror=" in page
    assert "<b>54.1" not in page


def test_bad_traces_are_told_and_the_rest_is_shown(reported: Reported) -> None:
    _, done, page = reported
    stray, broken = done.notes
    assert "1 traces without their episode, not shown: traces/idm/speed_limit-nowhere-v0.parquet" in stray
    assert broken.startswith("1 episodes cannot be played: ")
    assert "cannot be read as a trace" in broken
    assert stray in unescape(page)
    assert broken in unescape(page)


def test_the_command_writes_the_same_bytes_again(
    reported: Reported, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run, _, page = reported
    out, err = in_process("report", capsys)(str(run), "--workers", "1", "--out", str(tmp_path / "new" / "again.html"))
    assert f"report    {tmp_path / 'new' / 'again.html'}" in out
    assert "players   3 of 4 playable episodes, 96 in all, " in out
    assert err.count("note: ") == 2
    assert (tmp_path / "new" / "again.html").read_text(encoding="utf-8") == page


@pytest.mark.usefixtures("no_charts")
def test_missing_records_come_first_in_the_title(tmp_path: Path, refused: Callable[..., str]) -> None:
    run = page_runs.make_run(tmp_path / "run", asked=50)
    assert "continue the run, or pass --allow-partial" in refused(run)
    assert not (run / NAME).exists()
    _, page = write(run, partial=True)
    assert "<title>PARTIAL, 4 episodes missing: " in page
    assert re.search(r'<h1 class="partial">PARTIAL, 4 episodes missing', page)
    assert "Records are missing" in page


def test_players_are_left_out_until_they_fit(tmp_path: Path) -> None:
    index = index_episodes(read_pool([page_runs.make_run(tmp_path / "run")], False))
    whole = embed(index, 10**6, 1, lambda done, of: None)
    assert (len(whole.rows), whole.notes) == (4, [])
    some = embed(index, whole.size - 500, 1, lambda done, of: None)
    assert some.size <= whole.size - 500
    assert 2 <= len(some.rows) < 4
    # Each planner's first episode is its violation.
    assert {0, 48} <= some.rows
    (note,) = some.notes
    assert note.startswith(f"{len(some.rows)} of 4 episodes can be played here (violations first")


@pytest.mark.slow
@pytest.mark.usefixtures("no_charts")
def test_the_other_half_of_a_failure_is_driven_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(embedding, "_packer", EpisodePacker)
    run = tmp_path / "driven"
    for command in (["run", "--planner", "idm", "--split", "dev", "--types", "yield", "--limit", "1"], ["report"]):
        where = ["--out", str(run)] if "run" in command else [str(run)]
        with pytest.raises(SystemExit, match="0"):
            main([*command, *where])
    assert "players   2 of 2 playable episodes, 2 in all" in capsys.readouterr().out
    assert len(list((run / "traces" / "idm").iterdir())) == 2


def test_a_bound_that_cannot_be_kept(reported: Reported, tmp_path: Path, refused: Callable[..., str]) -> None:
    line = refused(reported[0], "--max-mb", "0.1", "--out", tmp_path / "x.html")
    assert "without any player the page has 0." in line
    assert not (tmp_path / "x.html").exists()


def test_several_runs_of_one_contract_are_one_page(tmp_path: Path) -> None:
    runs = [page_runs.make_run(tmp_path / name, (name,)) for name in ("idm", "mine")]
    pool = read_pool(runs, False)
    index = index_episodes(pool)
    assert "idm, mine: 2 of 29 types" in heading(pool)["title"]
    assert (len(index), len(index.traced), index.notes) == (96, 4, ())
    assert {index.trace(row).parents[2].name for row in index.traced} == {"idm", "mine"}


@pytest.mark.usefixtures("no_charts")
@pytest.mark.parametrize(("planners", "there"), [(5, False), (6, True)])
def test_what_goes_with_scd_is_said_of_six_planners(tmp_path: Path, planners: int, there: bool) -> None:
    run = page_runs.make_run(tmp_path / "run", tuple(f"p{k}" for k in range(planners)))
    pool = read_pool([run], False)
    shown = {section["id"] for section in sections(pool, index_episodes(pool))}
    assert {"summary", "types"} < shown
    assert ("correlations" in shown) is there


def test_what_is_refused_in_one_line(tmp_path: Path, refused: Callable[..., str]) -> None:
    run = page_runs.make_run(tmp_path / "run")
    other = page_runs.make_run(tmp_path / "other", ("mine",), contract="ab" * 32)
    assert "has contract" in refused(run, other)
    fewer = run_builders.make_run(tmp_path / "fewer", run_builders.episodes("mine", maps=5))
    assert "have different scenarios" in refused(run, fewer)
    again = page_runs.make_run(tmp_path / "again", ("idm",))
    assert "give it once only" in refused(run, again)
    assert "no run folder" in refused(tmp_path / "nothing")
    old = page_runs.make_run(tmp_path / "old")
    change_manifest(old, schema_version=0)
    assert "schema version 0, this tsbench reads" in refused(old)
    for name in ("episodes.parquet", "violations.parquet"):
        torn = page_runs.make_run(tmp_path / f"torn-{name}")
        (torn / name).write_bytes((torn / name).read_bytes()[:-20])
        assert name in refused(torn)
    (tmp_path / "file").write_text("")
    assert "file" in refused(run, "--out", tmp_path / "file" / "x.html")


def test_a_figure_without_an_interval_says_why() -> None:
    columns = (Column("planner", "planner", Kind.TEXT), Column("scd", "SCD\n%"))
    sure = Row(("a", Value(50.0, 40.0, 60.0, 30)))
    unsure = Row(("b", Value(50.0, None, None, 4, "only 4 places, fewer than 5")))
    for rows, notes in (
        ((sure,), ("a note",)),
        ((sure, unsure, unsure), ("a note", "why some figures have no interval: only 4 places, fewer than 5")),
    ):
        assert show(Analysis("one", "One", "", Table(columns, rows, 1), ("a note",)))["notes"] == notes
