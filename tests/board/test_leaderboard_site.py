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
from command_line import in_process
from forgeries import slow_down
from submitted import TOWN, edition

from tsbench.board.players import copy_traces, telling
from tsbench.board.site import build_site
from tsbench.board.submission import Figure, Submission, SubmittedEpisode
from tsbench.board.verification import Mismatch, Verification, draw
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


def put(folder: Path, name: str, told: Submission | Verification) -> str:
    path = folder / "all" / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(told.to_json(), encoding="utf-8")
    return hashlib.sha256(path.read_bytes()).hexdigest()


def record(of: str, **changes: object) -> Verification:
    plain = Verification(
        of, "t", "alice", "2026-01-02", "0.1.0", 7, 2, TWO, 2, (), (), (), {}, {"processor": "x"}, True
    )
    return replace(plain, **changes)  # type: ignore[arg-type]


def order(page: str) -> list[str]:
    return re.findall(r'<th scope="row" class="stays"><a href="[^"]+\.html#s-[0-9a-f]{8}">([^<]+)</a>', page)


def build(folder: Path, players: int = 0) -> str:
    """The first page of the site of all that was put here."""
    build_site(folder / "all", folder / "site", players)
    return (folder / "site" / "index.html").read_text()


def own(folder: Path, name: str = "idm") -> str:
    """The page of the only planner of this name."""
    (page,) = (folder / "site").glob(f"{name}-{'[0-9a-f]' * 16}.html")
    return page.read_text()


def test_rows_stand_by_paired_scd_and_refuted_ones_last(honest: Make, tmp_path: Path) -> None:
    put(tmp_path, "a/idm.json", honest("idm", note="Reads <b>nothing</b>."))
    good = put(tmp_path, "b/e.json", honest("idm-e", title="Expert", third_party=True))
    put(tmp_path, "b/alice.json", record(good))
    page = build(tmp_path)
    assert order(page) == ["Expert", "idm"]
    assert "confirmed" in page
    assert "third-party" in page
    assert f"{edition()}, dev split" in page
    assert "Reads &lt;b&gt;nothing&lt;/b&gt;." in own(tmp_path)
    assert "Nobody yet." in own(tmp_path)
    # One who finds it otherwise is enough.
    wrong = record(good, verifier="bob", equal=1, differences=(Mismatch(TWO[1], "verdict is another"),))
    put(tmp_path, "b/bob.json", wrong)
    page = build(tmp_path)
    assert order(page) == ["idm", "Expert"]
    assert "Refuted" in own(tmp_path, "idm-e")
    assert "verdict is another" in own(tmp_path, "idm-e")


def test_floors_stand_apart(honest: Make, tmp_path: Path) -> None:
    floor = honest("idm-e", title="Ground")
    put(tmp_path, "floor.json", replace(floor, planner=replace(floor.planner, floor=True)))
    put(tmp_path, "idm.json", honest("idm"))
    page = build(tmp_path)
    # Though its figures are the better ones.
    assert order(page) == ["idm", "Ground"]
    rows, floors = page.split('<tbody class="floors">')
    assert "paired SCD by planner, exact perception: " in page
    assert "Ground" in floors
    assert "Ground" not in rows.split("<tbody>")[1]


def test_seeds_of_one_planner_stand_as_mean_and_spread_above_their_rows(honest: Make, tmp_path: Path) -> None:

    def named(planner: str, name: str, **changes: object) -> Submission:
        made = honest(planner, title=name, **changes)
        return replace(made, planner=replace(made.planner, name=name))

    put(tmp_path, "0.json", named("idm", "mine"))
    put(tmp_path, "1.json", named("idm-e", "mine-seed1"))
    # Of others: by name alone it is no seed of theirs.
    put(tmp_path, "2.json", named("idm", "mine-seed2", authors="B. Other"))
    put(tmp_path, "3.json", named("idm", "other-seed3"))
    page = build(tmp_path)
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
    put(tmp_path, "bad.json", bad)
    assert '<tbody class="seeds">' not in build(tmp_path)


def test_the_code_of_a_row_is_a_link_where_it_may_be_and_titles_are_no_markup(honest: Make, tmp_path: Path) -> None:
    out = tmp_path / "site"
    put(tmp_path, "idm.json", honest("idm", url="https://example.org/mine"))
    put(tmp_path, "e.json", honest("idm-e", url="javascript:alert(1)", title="<script>alert(1)</script>"))
    page = build(tmp_path)
    assert 'href="https://example.org/mine" rel="nofollow"' in page
    assert "javascript:alert" not in page
    assert not [path for path in out.iterdir() if "<script>alert" in path.read_text()]


def test_bytes_and_verdicts_are_told_apart(honest: Make, tmp_path: Path) -> None:
    of = put(tmp_path, "idm.json", honest("idm"))
    why = ("the arithmetic of libm is another (glibc 2.36, now glibc 2.40)", "numpy is 1.0, not 2.0")
    few = record(of, sample=8, driven=EIGHT, equal=7, explained=(EIGHT[7],), arithmetic_differences=why)
    most = record(of, verifier="bob", equal=0, explained=TWO, arithmetic_differences=why)
    put(tmp_path, "few.json", few)
    page = build(tmp_path)
    assert f"by alice: 8 of {DEV_ROWS}" in page
    assert "7 to the byte, 1 by verdict only" in page
    assert '<span class="good">confirmed</span>' in page
    assert "bytes not comparable" not in page
    put(tmp_path, "most.json", most)
    page = build(tmp_path)
    assert '<span class="half-good">verdicts equal, bytes not comparable</span>' in page
    assert "0 to the byte, 2 by verdict only" in page
    assert "; ".join(why) in own(tmp_path)
    assert "only verdicts speak for this row" in own(tmp_path)


def test_nothing_is_green_that_was_driven_beside_the_referee(honest: Make, tmp_path: Path) -> None:
    of = put(tmp_path, "idm.json", honest("idm"))
    put(tmp_path, "v.json", record(of, isolated=False))
    for page in (build(tmp_path), own(tmp_path)):
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
    made = honest("idm")
    for number, called in enumerate((first, first, name)):
        planner = replace(made.planner, name=called, code_sha256=str(number) * 64)
        put(tmp_path, f"{number}.json", replace(made, planner=planner, title=(title * (number == 2)) or called))
        if number == 1:
            # One name for two planners is in plain sight.
            assert len(order(build(tmp_path))) == 2
    with pytest.raises(InputError, match=rf"2\.json: .* looks like {re.escape(ascii(first))} of .*0\.json: one of"):
        build(tmp_path)


def test_levels_have_tables_of_their_own_and_a_curve(honest: Make, tmp_path: Path) -> None:
    put(tmp_path, "exact.json", honest("idm-e"))
    for name in ("poor", "good"):
        put(tmp_path, f"{name}.json", honest("idm-e", perception=load_level(name)))
    fog = replace(load_level("poor"), name="fog", right=0.5)  # type: ignore[type-var]
    put(tmp_path, "fog.json", honest("idm", perception=fog))
    floor = honest("idm", title="Ground")
    put(tmp_path, "floor.json", replace(floor, planner=replace(floor.planner, name="g", floor=True)))
    page = build(tmp_path)
    assert re.findall("<h3>Perception: ([^<]+)</h3>", page) == ["exact", "good", "poor", "fog"]
    (label,) = re.findall('aria-label="(paired SCD of [^"]+)"', page)
    exact = re.match(r"paired SCD of idm-e by level: exact ([\d.]+) % \(95 % interval ", label)
    assert exact is not None
    same = (f"{level} {exact[1]} %" for level in ("good", "poor"))
    assert [name in label for name in (*same, "floor Ground ")] == [True] * 3
    # A planner of one level has no curve; all of one planner stand on its page.
    assert label in own(tmp_path, "idm-e")
    assert len(set(re.findall(r'href="#(s-[0-9a-f]{8})"', own(tmp_path, "idm-e")))) == 3


def test_a_planner_over_cities(honest: Make, tmp_path: Path) -> None:
    out = tmp_path / "site"
    put(tmp_path, "home.json", honest("idm"))
    put(tmp_path, "away.json", honest("idm", city="elsewhere", edition="elsewhere-2026.2", contract="1" * 64))
    build(tmp_path)
    assert "paired SCD of idm by city, dev split: elsewhere " in own(tmp_path)
    # Another code under the same name is another planner, and none is found by trial that has its number.
    away = honest("idm", city="elsewhere", contract="1" * 64)
    put(tmp_path, "away.json", replace(away, planner=replace(away.planner, code_sha256="f" * 64)))
    build(tmp_path)
    assert len(list(out.glob("idm-*.html"))) == 2


def test_failures_are_those_of_the_submission(driven: Path, honest: Make, tmp_path: Path) -> None:
    base = tmp_path / "all"
    put(tmp_path, "idm.json", honest("idm"))
    copied = copy_traces(driven, honest("idm"), base / "idm.json", 3)
    assert copied >= 3
    assert copied == len(list((base / "idm.traces").iterdir()))
    build(tmp_path, players=2)
    assert 2 <= own(tmp_path).count('data-blob="episode/') <= 4
    assert 'id="player"' in own(tmp_path)
    # Another episode's trace under the name of this one.
    one, other = sorted((base / "idm.traces").iterdir())[:2]
    one.write_bytes(other.read_bytes())
    with pytest.raises(InputError, match="is of another scenario than"):
        build(tmp_path, players=3)
    # And edited ones.
    one.unlink()
    for path in (base / "idm.traces").iterdir():
        slow_down(path)
    with pytest.raises(InputError, match="idm "):
        build(tmp_path, players=3)


def test_the_most_frequent_failures_come_first() -> None:
    def one(name: str, *clauses: str, outcome: str = "arrived") -> SubmittedEpisode:
        return SubmittedEpisode(name, outcome, not clauses and outcome == "arrived", clauses, "")

    episodes = [one("a", "x"), one("b", "y"), one("c", "y"), one("d"), one("e", outcome="stuck"), one("f", "y")]
    assert [e.scenario_id for e in telling(episodes, 4)] == ["b", "e", "a", "c"]
    assert [e.scenario_id for e in telling(episodes, 9)] == ["b", "e", "a", "c", "f"]


def test_what_does_not_belong_is_refused(honest: Make, tmp_path: Path) -> None:
    base, made = tmp_path / "all", honest("idm")
    digest = put(tmp_path, "idm.json", made)
    forged = replace(made, figures=(replace(made.figures[0], value=99.0), *made.figures[1:]))
    put(tmp_path, "forged.json", forged)
    with pytest.raises(InputError, match=r"forged\.json: its figures do not follow from its episodes"):
        build(tmp_path)
    (base / "forged.json").unlink()
    # A submission that was changed after somebody verified it has lost the record.
    put(tmp_path, "v.json", record(digest))
    put(tmp_path, "idm.json", replace(made, note="better now"))
    with pytest.raises(InputError, match=r"v\.json: is of a submission that is not below"):
        build(tmp_path)
    (base / "v.json").write_text('{"kind": "else"}')
    with pytest.raises(InputError, match="neither a submission nor"):
        build(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        build(tmp_path / "none")


def test_a_record_is_of_what_a_submission_says_and_of_its_episodes(honest: Make, tmp_path: Path) -> None:
    base = tmp_path / "all"
    digest = put(tmp_path, "idm.json", honest("idm"))
    # In another layout it says the same; and twice it is not there.
    data = json.loads((base / "idm.json").read_text())
    (base / "idm.json").write_text(json.dumps(data))
    put(tmp_path, "v.json", record(digest))
    assert len(order(build(tmp_path))) == 1
    (base / "again.json").write_text(json.dumps(data, indent=3))
    with pytest.raises(InputError, match=r"says what .*again\.json says: remove one"):
        build(tmp_path)
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
        put(tmp_path, "v.json", record(digest, **changes))
        with pytest.raises(InputError, match=told):
            build(tmp_path)


def test_what_is_no_regular_file_is_refused(honest: Make, tmp_path: Path) -> None:
    base = tmp_path / "all"
    put(tmp_path, "idm.json", honest("idm"))
    for name, make in (
        ("link", lambda path: path.symlink_to(tmp_path / "elsewhere.json")),
        ("pipe", os.mkfifo),
        ("folder", Path.mkdir),
    ):
        path = base / f"{name}.json"
        make(path)
        with pytest.raises(InputError, match=f"{name}.json: is no regular file"):
            build(tmp_path)
        path.rmdir() if path.is_dir() else path.unlink()


def test_a_new_site_takes_the_place_of_the_old_one_whole(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    put(tmp_path, "idm.json", honest("idm"))
    build(tmp_path)
    old = {path.name for path in out.iterdir()}
    (base / "idm.json").unlink()
    put(tmp_path, "e.json", honest("idm-e"))
    build(tmp_path)
    assert {path.name for path in out.iterdir()} & old == {"index.html"}
    # What is refused changes nothing, and a folder with other things in it is nobody's site.
    (base / "x.json").write_text("{}")
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    with pytest.raises(InputError):
        build(tmp_path)
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    (base / "x.json").unlink()
    for name in ("diary.txt", "mine.html"):
        (out / name).touch()
        with pytest.raises(InputError, match=rf"{name} is no page of a leaderboard"):
            build(tmp_path)
        (out / name).unlink()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["all", "site"]


def test_scenes_with_two_signs_stand_by_squared_scd(honest: Make, tmp_path: Path) -> None:
    for name, value in (("idm", 40.0), ("idm-e", 20.0)):
        squares = (Figure(SQUARED, over, value, 0.0, 99.0, 5) for over in ("all", "limit_and_yield"))
        figures = (*squares, *honest(name).figures)
        put(tmp_path, f"{name}.json", replace(honest(name), contract="0" * 64, figures=figures))
    index = build(tmp_path)
    assert order(index) == ["idm", "idm-e"]
    assert "squared SCD" in index
    columns = re.search(r'<thead><tr><th scope="col">type</th>(.*)</tr></thead>', own(tmp_path, "idm-e"))
    assert re.findall(r">(\w+)</th>", columns[1]) == ["squared", "paired", "signed", "contrast"]
    assert re.search(r"limit_and_yield</th><td[^>]*>20\.0", own(tmp_path, "idm-e"))


def test_data_that_are_not_here_are_said(honest: Make, tmp_path: Path) -> None:
    put(tmp_path, "x.json", replace(honest("idm"), contract="0" * 64))
    index = build(tmp_path)
    assert "The data of its contract are not here" in own(tmp_path)
    # In no table of the edition that it names, and marked.
    assert f"{honest('idm').edition} (unknown contract), dev split" in index
    assert "not checked" in index


def test_from_the_command_line(
    run: Path, released: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    submit, verify, leaderboard = (in_process(name, capsys) for name in ("submit", "verify", "leaderboard"))
    said, _ = submit(str(run), "--planner", "idm-e", "--authors", "us", "--shared-process")
    assert f"idm-e-dev.json: idm-e, {DEV_ROWS} episodes" in said
    draw = ("--sample", "1", "--seed", "1", "--by", "me", "--workers", "1")
    assert verify("idm-e-dev.json", *draw, "--out", "record.json")[0].splitlines()[-1] == "confirmed"
    assert (
        verify("idm-e-dev.json", *draw, "--planner", "idm", "--shared-process", expect=1)[0].splitlines()[-1]
        == "refuted"
    )
    # Other bytes that another arithmetic would explain.
    data = json.loads(Path("idm-e-dev.json").read_text())
    data["arithmetic"]["answers"]["libm"] = "f" * 16
    for number, episode in enumerate(data["episodes"]):
        episode["digest"] = f"{number:032x}"
    Path("other.json").write_text(json.dumps(data))
    assert (
        verify("other.json", *draw, "--shared-process", expect=3)[0].splitlines()[-1]
        == "verdicts equal, bytes not comparable"
    )
    (tmp_path / "board").mkdir()
    for name in ("idm-e-dev.json", "record.json"):
        (tmp_path / name).rename(tmp_path / "board" / name)
    assert "1 rows" in leaderboard("build", "board", "--out", "site")[0]
    index = (tmp_path / "site/index.html").read_text()
    assert released in index
    assert "shared process" in index
