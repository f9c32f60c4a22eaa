"""The site of submissions: who stands where, and what is refused."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from forgeries import slow_down
from submitted import TOWN, edition

from tsbench.board.players import copy_traces, telling
from tsbench.board.site import build_site
from tsbench.board.submission import Figure, Submission, SubmittedEpisode
from tsbench.board.verification import Mismatch, Verification, draw
from tsbench.cli import main
from tsbench.core.errors import InputError
from tsbench.episode.perception_level import load_level
from tsbench.metrics.scd import PAIRED, SQUARED
from tsbench.run.edition import contract_now
from tsbench.scenarios.data_set import DataSet

Make = Callable[..., Submission]
ROWS = DataSet(TOWN).table("dev")
CONTRACT = contract_now(DataSet(TOWN), "dev")
DEV, DEV_ROWS = sorted(row.scenario_id for row in ROWS), len(ROWS)


def drawn(count: int) -> tuple[str, ...]:
    """What a verifier with the seed 7 has to drive."""
    return tuple(row.scenario_id for row in draw(CONTRACT, ROWS, ROWS, count, 7))  # type: ignore[arg-type]


TWO, EIGHT = drawn(2), drawn(8)


def put(folder: Path, name: str, submission: Submission) -> str:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(submission.to_json(), encoding="utf-8")
    return hashlib.sha256(path.read_bytes()).hexdigest()


def record(of: str, **changes: object) -> Verification:
    plain = Verification(
        of, "t", "alice", "2026-01-02", "0.1.0", 7, 2, TWO, 2, (), (), (), {}, {"processor": "x"}, True
    )
    return replace(plain, **changes)  # type: ignore[arg-type]


def order(page: str) -> list[str]:
    return re.findall(r'<th scope="row" class="stays"><a href="[^"]+\.html#s-[0-9a-f]{8}">([^<]+)</a>', page)


def build(folder: Path, out: Path, players: int = 0) -> str:
    """The site's first page."""
    build_site(folder, out, players)
    return (out / "index.html").read_text()


def test_rows_stand_by_paired_scd_and_refuted_ones_last(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    put(base, "a/idm.json", honest("idm", note="Reads <b>nothing</b>."))
    good = put(base, "b/e.json", honest("idm-e", title="Expert", third_party=True))
    (base / "b" / "alice.json").write_text(record(good).to_json())
    page = build(base, out)
    assert order(page) == ["Expert", "idm"]
    assert "confirmed" in page
    assert "third-party" in page
    assert f"{edition()}, dev split" in page
    (own,) = set(out.glob("idm-*.html")) - set(out.glob("idm-e-*.html"))
    assert "Reads &lt;b&gt;nothing&lt;/b&gt;." in own.read_text()
    assert "Nobody yet." in own.read_text()
    # One who finds it otherwise is enough.
    wrong = record(good, verifier="bob", equal=1, differences=(Mismatch(TWO[1], "verdict is another"),))
    (base / "b" / "bob.json").write_text(wrong.to_json())
    page = build(base, out)
    assert order(page) == ["idm", "Expert"]
    (theirs,) = out.glob("idm-e-*.html")
    assert "Refuted" in theirs.read_text()
    assert "verdict is another" in theirs.read_text()


def test_floors_stand_apart(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    floor = honest("idm-e", title="Ground")
    put(base, "floor.json", replace(floor, planner=replace(floor.planner, floor=True)))
    put(base, "idm.json", honest("idm"))
    page = build(base, out)
    # Though its figures are the better ones.
    assert order(page) == ["idm", "Ground"]
    rows, floors = page.split('<tbody class="floors">')
    assert "paired SCD by planner, exact perception: " in page
    assert "Ground" in floors
    assert "Ground" not in rows.split("<tbody>")[1]


def test_seeds_of_one_planner_stand_as_mean_and_spread_above_their_rows(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"

    def named(planner: str, name: str, **changes: object) -> Submission:
        made = honest(planner, title=name, **changes)
        return replace(made, planner=replace(made.planner, name=name))

    put(base, "0.json", named("idm", "mine"))
    put(base, "1.json", named("idm-e", "mine-seed1"))
    # Of others: by name alone it is no seed of theirs.
    put(base, "2.json", named("idm", "mine-seed2", authors="B. Other"))
    put(base, "3.json", named("idm", "other-seed3"))
    page = build(base, out)
    assert order(page) == ["mine-seed1", "mine", "mine-seed2", "other-seed3"]
    (seeds,) = re.findall(r'<tbody class="seeds">(.*?)</tbody>', page, re.S)
    assert re.findall(r'<th scope="row">(\S+) <span class="flag">(\d) seeds', seeds) == [("mine", "2")]
    scd = [{(f.figure, f.over): f.value for f in honest(p).figures}[PAIRED, "all"] for p in ("idm", "idm-e")]
    low, high = (value or 0.0 for value in scd)
    assert low < high
    first = re.search(r'data-value="([0-9.]+)">([0-9.]+)<small>± ([0-9.]+)</small>', seeds)
    assert float(first[1]) == pytest.approx((low + high) / 2)
    assert float(first[3]) == pytest.approx(abs(high - low) / 2**0.5, abs=0.05)
    # So they stand in the chart, too.
    (drawn,) = re.findall(r"paired SCD by planner, exact perception: ([^<]*)", page)
    ends = f"{(low + high) / 2 - float(first[3]):.1f} to {(low + high) / 2 + float(first[3]):.1f}"
    assert re.findall(r"mine[^;]*", drawn)[:1] == [f"mine (2 seeds) {first[2]} % (standard deviation {ends})"]
    assert re.findall(r"(\S+)(?: \(2 seeds\))? [0-9.]+ % \(", drawn) == ["mine", "mine-seed2", "other-seed3"]
    for anchor in re.findall(r'href="#(s-[0-9a-f]{8})"', seeds):
        assert f'id="{anchor}"' in page
    # A refuted seed is none.
    bad = record(named("idm-e", "mine-seed1").sha256, verifier="b", equal=1, differences=(Mismatch(TWO[1], "other"),))
    (base / "bad.json").write_text(bad.to_json())
    assert '<tbody class="seeds">' not in build(base, out)


def test_the_code_of_a_row_is_a_link_where_it_may_be_and_titles_are_no_markup(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    put(base, "idm.json", honest("idm", url="https://example.org/mine"))
    put(base, "e.json", honest("idm-e", url="javascript:alert(1)", title="<script>alert(1)</script>"))
    page = build(base, out)
    assert 'href="https://example.org/mine" rel="nofollow"' in page
    assert "javascript:alert" not in page
    assert not [path for path in out.iterdir() if "<script>alert" in path.read_text()]


def test_bytes_and_verdicts_are_told_apart(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    of = put(base, "idm.json", honest("idm"))
    why = ("the arithmetic of libm is another (glibc 2.36, now glibc 2.40)", "numpy is 1.0, not 2.0")
    few = record(of, sample=8, driven=EIGHT, equal=7, explained=(EIGHT[7],), arithmetic_differences=why)
    most = record(of, verifier="bob", equal=0, explained=TWO, arithmetic_differences=why)
    (base / "few.json").write_text(few.to_json())
    page = build(base, out)
    assert f"by alice: 8 of {DEV_ROWS}" in page
    assert "7 to the byte, 1 by verdict only" in page
    assert '<span class="good">confirmed</span>' in page
    assert "bytes not comparable" not in page
    (base / "most.json").write_text(most.to_json())
    page = build(base, out)
    assert '<span class="half-good">verdicts equal, bytes not comparable</span>' in page
    assert "0 to the byte, 2 by verdict only" in page
    (own,) = out.glob("idm-*.html")
    assert "; ".join(why) in own.read_text()
    assert "only verdicts speak for this row" in own.read_text()


def test_nothing_is_green_that_was_driven_beside_the_referee(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    of = put(base, "idm.json", honest("idm"))
    (base / "v.json").write_text(record(of, isolated=False).to_json())
    build(base, out)
    (own,) = out.glob("idm-*.html")
    for page in ((out / "index.html").read_text(), own.read_text()):
        assert '<span class="half-good">confirmed, in a shared process</span>' in page
        assert 'class="good"' not in page


@pytest.mark.parametrize(
    ("first", "name", "title"),
    [
        ("coco", "\u0441\u043e\u0441\u043e", ""),
        ("coco", "other", "\u0441\u043e\u0441\u043e"),
        ("model-l", "model-1", ""),
        ("model", "rnodel", ""),
        ("planér", "plane\u0301r", ""),
    ],
)
def test_two_planners_whose_names_look_alike_are_no_board(
    honest: Make, tmp_path: Path, first: str, name: str, title: str
) -> None:
    base, made = tmp_path / "all", honest("idm")
    for number, called in enumerate((first, first, name)):
        planner = replace(made.planner, name=called, code_sha256=str(number) * 64)
        put(base, f"{number}.json", replace(made, planner=planner, title=(title * (number == 2)) or called))
        if number == 1:
            # One name for two planners is in plain sight.
            assert len(order(build(base, tmp_path / "site"))) == 2
    with pytest.raises(InputError, match=rf"2\.json: .* looks like {re.escape(ascii(first))} of .*0\.json: one of"):
        build(base, tmp_path / "site")


def test_levels_have_tables_of_their_own_and_a_curve(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    put(base, "exact.json", honest("idm-e"))
    for name in ("poor", "good"):
        put(base, f"{name}.json", honest("idm-e", perception=load_level(name)))
    fog = replace(load_level("poor"), name="fog", right=0.5)  # type: ignore[type-var]
    put(base, "fog.json", honest("idm", perception=fog))
    floor = honest("idm", title="Ground")
    put(base, "floor.json", replace(floor, planner=replace(floor.planner, name="g", floor=True)))
    page = build(base, out)
    assert re.findall("<h3>Perception: ([^<]+)</h3>", page) == ["exact", "good", "poor", "fog"]
    (label,) = re.findall('aria-label="(paired SCD of [^"]+)"', page)
    exact = re.match(r"paired SCD of idm-e by level: exact ([\d.]+) % \(95 % interval ", label)
    assert exact is not None
    same = (f"{level} {exact[1]} %" for level in ("good", "poor"))
    assert [name in label for name in (*same, "floor Ground ")] == [True] * 3
    # A planner of one level has no curve; all of one planner stand on its page.
    (own,) = out.glob("idm-e-*.html")
    assert label in own.read_text()
    assert len(set(re.findall(r'href="#(s-[0-9a-f]{8})"', own.read_text()))) == 3


def test_a_planner_over_cities(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    put(base, "home.json", honest("idm"))
    put(base, "away.json", honest("idm", city="elsewhere", edition="elsewhere-2026.2", contract="1" * 64))
    build(base, out)
    (own,) = out.glob("idm-*.html")
    assert "paired SCD of idm by city, dev split: elsewhere " in own.read_text()
    # Another code under the same name is another planner, and none is found by trial that has its number.
    assert re.fullmatch(r"idm-[0-9a-f]{16}\.html", own.name)
    away = honest("idm", city="elsewhere", contract="1" * 64)
    put(base, "away.json", replace(away, planner=replace(away.planner, code_sha256="f" * 64)))
    build(base, out)
    assert len(list(out.glob("idm-*.html"))) == 2


def test_failures_are_those_of_the_submission(driven: Path, honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    put(base, "idm.json", honest("idm"))
    copied = copy_traces(driven, honest("idm"), base / "idm.json", 3)
    assert copied >= 3
    assert copied == len(list((base / "idm.traces").iterdir()))
    build(base, out, players=2)
    (own,) = out.glob("idm-*.html")
    assert 2 <= own.read_text().count('data-blob="episode/') <= 4
    assert 'id="player"' in own.read_text()
    # Another episode's trace under the name of this one.
    one, other = sorted((base / "idm.traces").iterdir())[:2]
    one.write_bytes(other.read_bytes())
    with pytest.raises(InputError, match="is of another scenario than"):
        build(base, out, players=3)
    # And edited ones.
    one.unlink()
    for path in (base / "idm.traces").iterdir():
        slow_down(path)
    with pytest.raises(InputError, match="idm "):
        build(base, out, players=3)


def test_the_most_frequent_failures_come_first() -> None:
    def one(name: str, *clauses: str, outcome: str = "arrived") -> SubmittedEpisode:
        return SubmittedEpisode(name, outcome, not clauses and outcome == "arrived", clauses, "")

    episodes = [one("a", "x"), one("b", "y"), one("c", "y"), one("d"), one("e", outcome="stuck"), one("f", "y")]
    assert [e.scenario_id for e in telling(episodes, 4)] == ["b", "e", "a", "c"]
    assert [e.scenario_id for e in telling(episodes, 9)] == ["b", "e", "a", "c", "f"]


def test_what_does_not_belong_is_refused(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    made = honest("idm")
    digest = put(base, "idm.json", made)
    forged = replace(made, figures=(replace(made.figures[0], value=99.0), *made.figures[1:]))
    put(base, "forged.json", forged)
    with pytest.raises(InputError, match=r"forged\.json: its figures do not follow from its episodes"):
        build(base, out)
    (base / "forged.json").unlink()
    # A submission that was changed after somebody verified it has lost the record.
    (base / "v.json").write_text(record(digest).to_json())
    put(base, "idm.json", replace(made, note="better now"))
    with pytest.raises(InputError, match=r"v\.json: is of a submission that is not below"):
        build(base, out)
    (base / "v.json").write_text('{"kind": "else"}')
    with pytest.raises(InputError, match="neither a submission nor"):
        build(base, out)
    with pytest.raises(InputError, match="no such folder"):
        build(tmp_path / "none", out)


def test_a_record_is_of_what_a_submission_says_and_of_its_episodes(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    digest = put(base, "idm.json", honest("idm"))
    # In another layout it says the same; and twice it is not there.
    data = json.loads((base / "idm.json").read_text())
    (base / "idm.json").write_text(json.dumps(data))
    (base / "v.json").write_text(record(digest).to_json())
    assert len(order(build(base, out))) == 1
    (base / "again.json").write_text(json.dumps(data, indent=3))
    with pytest.raises(InputError, match=r"says what .*again\.json says: remove one"):
        build(base, out)
    (base / "again.json").unlink()
    for changes, told in (
        ({"driven": (), "equal": 0}, "no episode was driven"),
        ({"driven": (DEV[0], DEV[0])}, "or one twice"),
        ({"equal": 1}, "the counts do not fit"),
        ({"explained": ("x",), "equal": 1}, "the counts do not fit"),
        ({"explained": TWO, "equal": 0}, "2 episodes have other bytes, and nothing explains them"),
        ({"driven": ("a", "b")}, "says that a was driven, of which"),
        ({"driven": TWO[:1], "equal": 1}, "seed 7 draws other episodes than it says"),
        ({"verifier": "alice\u200b"}, "has a character that nobody sees"),
    ):
        (base / "v.json").write_text(record(digest, **changes).to_json())
        with pytest.raises(InputError, match=told):
            build(base, out)


def test_what_is_no_regular_file_is_refused(honest: Make, tmp_path: Path) -> None:
    base = tmp_path / "all"
    put(base, "idm.json", honest("idm"))
    for name, make in (
        ("link", lambda path: path.symlink_to(tmp_path / "elsewhere.json")),
        ("pipe", os.mkfifo),
        ("folder", Path.mkdir),
    ):
        path = base / f"{name}.json"
        make(path)
        with pytest.raises(InputError, match=f"{name}.json: is no regular file"):
            build(base, tmp_path / "site")
        path.rmdir() if path.is_dir() else path.unlink()


def test_a_new_site_takes_the_place_of_the_old_one_whole(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    put(base, "idm.json", honest("idm"))
    build(base, out)
    old = {path.name for path in out.iterdir()}
    (base / "idm.json").unlink()
    put(base, "e.json", honest("idm-e"))
    build(base, out)
    assert {path.name for path in out.iterdir()} & old == {"index.html"}
    # What is refused changes nothing, and a folder with other things in it is nobody's site.
    (base / "x.json").write_text("{}")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with pytest.raises(InputError):
        build(base, out)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    (base / "x.json").unlink()
    for name in ("diary.txt", "mine.html"):
        (out / name).touch()
        with pytest.raises(InputError, match=rf"{name} is no page of a leaderboard"):
            build(base, out)
        (out / name).unlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all", "site"]


def test_scenes_with_two_signs_stand_by_squared_scd(honest: Make, tmp_path: Path) -> None:
    for name, value in (("idm", 40.0), ("idm-e", 20.0)):
        squares = (Figure(SQUARED, over, value, 0.0, 99.0, 5) for over in ("all", "limit_and_yield"))
        figures = (*squares, *honest(name).figures)
        put(tmp_path / "all", f"{name}.json", replace(honest(name), contract="0" * 64, figures=figures))
    index = build(tmp_path / "all", tmp_path / "site")
    assert order(index) == ["idm", "idm-e"]
    assert "squared SCD" in index
    (own,) = (tmp_path / "site").glob("idm-e-*.html")
    columns = re.search(r'<thead><tr><th scope="col">type</th>(.*)</tr></thead>', own.read_text())
    assert re.findall(r">(\w+)</th>", columns[1]) == ["squared", "paired", "signed", "contrast"]
    assert re.search(r"limit_and_yield</th><td[^>]*>20\.0", own.read_text())


def test_data_that_are_not_here_are_said(honest: Make, tmp_path: Path) -> None:
    put(tmp_path / "all", "x.json", replace(honest("idm"), contract="0" * 64))
    build(tmp_path / "all", tmp_path / "site")
    (own,) = (tmp_path / "site").glob("idm-*.html")
    assert "The data of its contract are not here" in own.read_text()
    # In no table of the edition that it names, and marked.
    index = (tmp_path / "site" / "index.html").read_text()
    assert f"{honest('idm').edition} (unknown contract), dev split" in index
    assert "not checked" in index


def test_from_the_command_line(
    run: Path, released: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["tsbench", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), capsys.readouterr().out

    code, said = call("submit", str(run), "--planner", "idm-e", "--authors", "us", "--shared-process")
    assert (code, f"idm-e-dev.json: idm-e, {DEV_ROWS} episodes" in said) == (0, True)
    draw = ("--sample", "1", "--seed", "1", "--by", "me", "--workers", "1")
    code, said = call("verify", "idm-e-dev.json", *draw, "--out", "record.json")
    assert (code, said.splitlines()[-1]) == (0, "confirmed")
    code, said = call("verify", "idm-e-dev.json", *draw, "--planner", "idm", "--shared-process")
    assert (code, said.splitlines()[-1]) == (1, "refuted")
    # Other bytes that another arithmetic would explain.
    data = json.loads(Path("idm-e-dev.json").read_text())
    data["arithmetic"]["answers"]["libm"] = "f" * 16
    for number, episode in enumerate(data["episodes"]):
        episode["digest"] = f"{number:032x}"
    Path("other.json").write_text(json.dumps(data))
    code, said = call("verify", "other.json", *draw, "--shared-process")
    assert (code, said.splitlines()[-1]) == (3, "verdicts equal, bytes not comparable")
    (tmp_path / "board").mkdir()
    for name in ("idm-e-dev.json", "record.json"):
        (tmp_path / name).rename(tmp_path / "board" / name)
    code, said = call("leaderboard", "build", "board", "--out", "site")
    assert (code, "1 rows" in said, (tmp_path / "site/index.html").is_file()) == (0, True, True)
    index = (tmp_path / "site/index.html").read_text()
    assert released in index
    assert "shared process" in index
