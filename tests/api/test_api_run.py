"""`Run`: tables as pandas, figures, comparison, and a player of an episode."""

from __future__ import annotations

import io
import shutil
from pathlib import Path

import pytest
from PIL import Image
from run_builders import episodes, failed, lost, make_run, pairs

import tsbench
from tsbench.core.errors import InputError


def test_tables(run: tsbench.Run) -> None:
    assert set(run.episodes.planner) == {"idm", "Parked"}
    assert list(run.timing.scenario_id) == list(run.episodes.scenario_id)
    assert set(run.violations.planner) <= {"idm", "Parked"}
    assert {"clause", "sentence", "target"} <= set(run.violations)


def test_the_type_of_a_pair_is_that_of_its_signed_half(tmp_path: Path) -> None:
    rows = tsbench.load_run(make_run(tmp_path / "run", pairs("idm", yield_m0_v0_c={"scd": False}))).episodes
    assert set(rows[rows.half == "contrast"].scenario_type) == {"main_road", "speed_limit"}
    assert dict(rows.groupby("pair_type").size()) == {"speed_limit": 48, "yield": 48}
    # As the summary has it: of yield 23 of 24 contrast halves are passed.
    contrast = rows[rows.half == "contrast"].groupby("pair_type")["scd"].mean()
    assert contrast["yield"] == pytest.approx(23 / 24)
    alone = tsbench.load_run(make_run(tmp_path / "alone", episodes("idm"))).episodes
    assert (alone.pair_type == alone.scenario_type).all()


def test_summary(tmp_path: Path) -> None:
    broken = {"speed_limit_m0_v0": lost("over_limit"), "yield_m1_v1": failed("it raised")}
    summary = tsbench.load_run(make_run(tmp_path / "run", pairs("idm", **broken))).summary()
    whole = summary.query("figure == 'paired_scd' and over == 'all'").set_index("reading")
    # 24 pairs of each of two types; of speed_limit one is lost, of yield one has an error.
    assert whole.value["strict"] == pytest.approx(100 * 23 / 24)
    assert whole.value["completed"] == pytest.approx(100 * (23 / 24 + 1) / 2)
    assert list(whole.n) == [48, 47]
    kinds = summary.query("figure == 'signed_scd' and over == 'type' and reading == 'strict'")
    assert dict(zip(kinds.name, kinds.value, strict=True)) == pytest.approx(
        dict.fromkeys(("speed_limit", "yield"), 100 * 23 / 24)
    )
    assert set(summary.query("figure == 'mean_speed'").unit) == {"m/s"}


def test_a_summary_shows_scd_on_a_narrow_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    rows = [row for name in ("idm", "a-planner-with-a-long-name") for row in pairs(name, speed_limit_m0_v0=lost())]
    summary = tsbench.load_run(make_run(tmp_path / "run", rows)).summary()
    lines = str(summary).splitlines()
    assert max(map(len, lines)) <= 80
    whole = summary.query("planner == 'idm' and figure == 'paired_scd' and over == 'all'").iloc[0]
    (line,) = [one.split() for one in lines if one.split()[:2] == ["idm", "paired_scd"]]
    assert line[2:] == [*(f"{whole[name]:.1f}" for name in ("value", "low", "high")), str(whole.n)]
    # It is a table of pandas, and what is taken from it is a plain one.
    assert "idm" not in str(summary[["value", "n"]])
    assert str(summary.drop(columns="value")).splitlines()[0].split()[0] == "planner"


def test_holes_are_named(tmp_path: Path) -> None:
    run = tsbench.load_run(make_run(tmp_path / "run", episodes("idm"), asked=50))
    with pytest.raises(InputError, match=r"without a record \(idm: 2 of 50\).* or pass allow_partial=True$"):
        run.summary()
    assert len(run.summary(allow_partial=True))
    assert repr(run).endswith("idm; 48 of 50 episodes, interrupted)")


def test_compare(tmp_path: Path) -> None:
    a = tsbench.load_run(make_run(tmp_path / "a", episodes("idm", yield_m0_v0=lost())))
    b = tsbench.load_run(make_run(tmp_path / "b", [*episodes("idm", speed_limit_m1_v1=lost()), *episodes("ppo")]))
    with pytest.raises(InputError, match=r"has planners idm, ppo: name one, other_planner='idm'$"):
        a.compare(b)
    found = a.compare(b, other_planner="idm")
    assert dict(zip(found.flips.scenario_id, found.flips.won, strict=True)) == {
        "yield-m0-v0": True, "speed_limit-m1-v1": False,
    }  # fmt: skip
    assert repr(found).endswith("48 paired scenarios; 1 won, 1 lost")
    first = found.differences.query("over == 'type' and name == 'yield'").iloc[0]
    assert (first.a, first.b) == pytest.approx((100 * 23 / 24, 100.0))
    equal = a.compare(a)
    assert repr(equal).endswith("0 won, 0 lost")


def test_an_episode_in_a_notebook(run: tsbench.Run, tmp_path: Path) -> None:
    first = run.episodes.scenario_id[0]
    shown = run.show(f"idm/{first}", time=1.0)
    for row in (0, 1):
        assert f'data-blob="episode/{row}"' in shown.page
    assert 'data-blob="episode/2"' not in shown.page
    assert shown._repr_html_().startswith('<iframe src="data:text/html;base64,')
    assert f"#play=idm%2F{first}&amp;t=1" in shown._repr_html_()
    assert shown.frame.startswith(b"\x89PNG")
    assert shown.frame != run.show(f"idm/{first}", time=3.0).frame
    assert shown.save(tmp_path / "frame.png").read_bytes() == shown._repr_png_()
    assert shown.save(tmp_path / "player.html").read_text() == shown.page


def test_an_episode_that_cannot_be_shown(run: tsbench.Run) -> None:
    with pytest.raises(InputError, match="no episode 'nothing'"):
        run.show("nothing")
    with pytest.raises(InputError, match="was driven by several planners, name one"):
        run.show(run.episodes.scenario_id[0])
    with pytest.raises(InputError, match=r"^time 999: the episode lasts"):
        _ = run.show(f"idm/{run.episodes.scenario_id[0]}", time=999.0).frame


@pytest.mark.slow
def test_a_player_in_an_output_cell(run: tsbench.Run, tmp_path: Path) -> None:
    """Chromium plays it inside of another page, without an error."""
    program = shutil.which("chromium") or pytest.skip("no chromium on this machine")
    from playwright.sync_api import expect, sync_playwright

    name = run.episodes.scenario_id[0]
    cell = tmp_path / "cell.html"
    cell.write_text(run.show(f"idm/{name}", time=0.5)._repr_html_())
    problems: list[str] = []
    with sync_playwright() as tool:
        browser = tool.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(cell.as_uri())
        frame = page.frames[1]
        clock = frame.locator("#player-clock")
        expect(clock).to_contain_text("0.5 s")
        assert frame.evaluate("tsb.player.halves.length") == 2
        frame.locator("#player-play").click()
        expect(clock).not_to_contain_text("0.5 s")
        frame.locator("#player-play").click()
        assert frame.evaluate("location.hash").startswith("#play=idm")
        browser.close()
    assert not problems


def test_scenarios() -> None:
    some = tsbench.load_scenarios("dev", "speed_limit")
    assert {scenario.row.pair_type for scenario in some} == {"speed_limit"}
    first = some[0]
    assert first.scene.start.lane
    assert all(lane.width > 0.0 for lane in first.network.lanes)
    assert first._repr_png_().startswith(b"\x89PNG")
    assert len(tsbench.load_scenarios("dev", ["speed"])) > len(some)
    for split, types, words in (
        ("exam", "", "split 'exam': expected"),
        ("dev", "speling", "^types speling: no such type"),
    ):
        with pytest.raises(InputError, match=words):
            tsbench.load_scenarios(split, types)


def test_what_is_refused_is_said_in_keywords(tmp_path: Path) -> None:
    a = tsbench.load_run(make_run(tmp_path / "a", episodes("idm")))
    other = tsbench.load_run(make_run(tmp_path / "b", episodes("idm"), contract="beef" * 16))
    with pytest.raises(InputError, match=r"force=True compares them all the same"):
        a.compare(other)
    assert a.compare(other, force=True).title.startswith("FORCED")
    fewer = tsbench.load_run(make_run(tmp_path / "c", episodes("idm", maps=5)))
    with pytest.raises(InputError, match=r"force=True compares the common ones"):
        a.compare(fewer)


def test_a_picture_prints_no_bytes(run: tsbench.Run) -> None:
    shown = run.show(f"idm/{run.episodes.scenario_id[0]}", time=1.0)
    picture = shown.frame
    assert picture == shown._repr_png_()
    assert len(f"{picture}") == len(str(picture)) < 80
    assert str(picture) == repr(picture)
    width, height = Image.open(io.BytesIO(picture)).size
    assert f"{width} x {height} px" in str(picture)
    assert len(repr(shown)) < 200
    assert "idm/" in repr(shown)
