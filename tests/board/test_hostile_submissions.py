"""What a stranger may write into a submission or a run: each is refused in one line, before anything is driven."""

from __future__ import annotations

import json
import os
import pwd
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
from forgeries import change_rows
from patience import HANG_S

from tsbench.board.claim import claim_of, claims_of
from tsbench.board.isolation.isolated_loading import changed_files
from tsbench.board.submission import Submission, read_submission
from tsbench.board.verification import ClaimVerdict, verify
from tsbench.core.errors import InputError
from tsbench.core.files import sha256_of
from tsbench.episode.perception_level import load_level

Make = Callable[..., Submission]
Json = dict[str, Any]
DRAW = {"sample": 1, "seed": 3, "verifier": "me", "workers": 1, "on_progress": lambda *_: None}


def put(data: Any, *where: str | int, to: object) -> None:
    *into, last = where
    for key in into:
        data = data[key]
    data[last] = to(data[last]) if callable(to) else to


def level(name: str, **changes: object) -> Json:
    poor = load_level("poor")
    assert poor is not None
    return {**asdict(poor), "name": name, **changes}


def nested(depth: int) -> object:
    made: object = 1
    for _ in range(depth):
        made = [made]
    return made


def but(**changes: object) -> Callable[[Json], Json]:
    return lambda there: {**there, **changes}


def without(key: str) -> Callable[[Json], Json]:
    return lambda there: {name: value for name, value in there.items() if name != key}


# Where in the file, what stands there (or is made of what stood there), what is said of it.
FIELDS = [
    (("device",), "cpu ", "device 'cpu ': expected cpu, cuda"),
    (("device",), "CPU", "device 'CPU': expected cpu, cuda"),
    (("device",), "", "device '': expected cpu, cuda"),
    (("city",), "../x", "city '../x': a city's name is of a-z"),
    (("city",), "/tmp", "city '/tmp': a city's name is of a-z"),
    (("city",), "moscow\n", "expected one line"),
    (("city",), "a" * 1001, "expected one line of at most 1000 characters"),
    (("city",), "a" * 101, "a city's name is of a-z"),
    (("split",), "/tmp/x.parquet", "split '/tmp/x.parquet': expected test"),
    (("split",), "../scenarios/dev", "split '../scenarios/dev': expected test"),
    (("split",), "Dev", "split 'Dev': expected test"),
    (("perception",), level("poor", right=0.99), "called poor, but is not tsbench's level of that name"),
    (("perception",), level("Poor"), "called Poor, but is not tsbench's level of that name"),
    (("perception",), level("exact"), "called exact, but is not tsbench's level of that name"),
    (("perception",), level("p\u043eor"), "mixes scripts (cyrillic, latin)"),
    (("perception",), level("x" * 201), "the perception level's name: expected a name of 1 to 200"),
    (("perception",), level("mine", noise_m=10**400), "perception: noise_m: Number out of range"),
    (("perception",), level("mine", right="nan"), "perception: right: must be a number, not 'nan'"),
    (("title",), "", "title: must be text of length >= 1"),
    (("title",), "idm\u200b", "has a character that nobody sees (\\u200b)"),
    (("title",), "\u0456dm", "mixes scripts (cyrillic, latin)"),
    (("title",), "idm\u2028", "title: expected one line"),
    (("planner", "name"), "id\u200bm", "has a character that nobody sees (\\u200b)"),
    (("planner", "name"), "idm\u200f", "has a character that nobody sees (\\u200f)"),
    (("planner", "name"), "idm\u3164", "has a character that nobody sees (\\u3164)"),
    (("planner", "name"), "idm ", "has spaces that nobody sees"),
    (("title",), "plant  2", "has spaces that nobody sees"),
    (("planner", "name"), "\U0001d422dm", "has a letter in the form of another"),
    (("planner", "name"), "\u0456dm", "mixes scripts (cyrillic, latin)"),
    (("planner", "name"), "idm\nconfirmed", "expected one line"),
    (("planner", "name"), "", "expected a name of 1 to 200 characters"),
    (("planner", "weights_sha256"), "\nconfirmed", "expected one line"),
    (("edition",), "2026.3\nconfirmed", "expected one line"),
    (("arithmetic", "versions", "numpy"), {"a": "b"}, "arithmetic: versions: numpy: must be text or nothing, not {"),
    (("arithmetic", "versions", "numpy"), "2\nconfirmed", "expected one line"),
    (("arithmetic", "libc"), "x" * 1001, "expected one line of at most 1000 characters"),
    (("arithmetic", "answers"), {}, "arithmetic: "),
    (("versions", "tsbench"), "\x1b[2J", "control characters in the text"),
    (("machine", "cores"), nested(60), "more than 50 levels deep"),
    (("machine", "cores"), float("nan"), "malformed submission"),
    (("rescored",), 10**6, "rescored: is no number of its episodes"),
    (("rescored",), -1, "rescored: must be a whole number >= 0, not -1"),
    (("rescored",), 10**400, "rescored: must be a whole number below 2^63"),
    (("isolation",), "sandbox", "malformed submission"),
    (("figures", 0, "value"), 10**400, "figures: number 1: value: "),
    (("figures", 0, "value"), 1e308, "figures: number 1: value: must be a number <= 100.0"),
    (("figures", 0, "low"), -1.0, "figures: number 1: low: must be a number >= 0.0"),
    (("figures", 0, "n"), -1, "figures: number 1: n: must be a whole number >= 0"),
    (("figures", 0, "over"), "all\nconfirmed", "expected one line"),
    (("kind",), "else", "no submission"),
    (("schema",), 2, "schema 2, this tsbench reads 1"),
    (("more",), 1, "malformed submission"),
    (("licence",), "mine", "malformed submission (licence"),
    (("arithmetic",), without("answers"), "malformed submission"),
    (("perception",), {"name": "poor"}, "malformed submission"),
    (("episodes",), lambda them: [*them, them[0]], "stands twice"),
    (("episodes",), lambda them: [{**one, "digest": "0" * 32} for one in them], "has the digest of"),
    (("episodes", 0, "outcome"), "won", "won"),
    (("episodes", 0, "scd"), "yes", "malformed submission"),
    (("episodes", 0, "digest"), "0" * 31, "digest: expected 32 hexadecimal digits"),
    (("episodes", 0), but(outcome="collision", scd=True, clauses=[]), "scd is true, which collision"),
    (("episodes", 0), but(outcome="arrived", scd=True, clauses=["c"]), "which arrived, c contradicts"),
    (("episodes", 0), but(outcome="arrived", scd=False, clauses=[]), "scd is false, which arrived"),
    (("planner", "name"), "x" * 100_001, "cannot be read as a submission"),
    (("figures", 0, "value"), "nan", "malformed submission"),
    (("machine", "cores"), float("inf"), "malformed submission"),
    (("city",), "\ud800", "control characters in the text"),
    (("title",), "x" * 201, "title: expected one line of at most 200 characters"),
    (("title",), "\x1b[2J", "control characters in the text"),
    (("authors",), "us\nthem", "authors: expected one line of at most 1000 characters"),
    (("note",), "x" * 10_001, "note: expected text of at most 10000 characters"),
]


def refusal(read: Callable[[Path], object], path: Path) -> str:
    with pytest.raises(InputError) as caught:
        read(path)
    line = str(caught.value)
    assert line.isprintable()
    assert line.startswith(str(path))
    return line


@pytest.mark.parametrize(("where", "to", "said"), FIELDS)
def test_a_field_that_no_run_writes(
    honest: Make, tmp_path: Path, where: tuple[str | int, ...], to: object, said: str
) -> None:
    data = json.loads(honest("idm").to_json())
    put(data, *where, to=to)
    path = tmp_path / "x.json"
    path.write_text(json.dumps(data))
    assert said in refusal(read_submission, path)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"kind": "' + "x" * 100_000_000 + '"}', "larger than 64 MiB"),
        ("[" * 100_000, "cannot be read as a submission"),
        ("[" * 900 + "]" * 900, "more than 50 levels deep"),
        ("9" * 5000, "cannot be read as a submission"),
    ],
    ids=["long", "open", "deep", "digits"],
)
def test_a_file_that_is_none(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "x.json"
    path.write_text(text)
    assert said in refusal(read_submission, path)


@pytest.mark.parametrize(
    ("where", "to", "said"),
    [
        (("effective", "device"), "cpu ", "device 'cpu ': expected cpu, cuda"),
        (("effective", "split"), "/tmp/x.parquet", "effective: split: '/tmp/x.parquet' is none of test, dev"),
        (("effective", "city"), "../x", "city '../x': a city's name is of a-z"),
        (("effective", "perception"), level("poor", right=0.99), "called poor, but is not tsbench's level"),
        (("arithmetic",), None, "arithmetic: "),
        (("arithmetic", "versions", "numpy"), "2\nconfirmed", "expected one line"),
        (("contract",), "x\nconfirmed", "expected one line"),
    ],
)
def test_a_run_may_say_no_more(run: Path, where: tuple[str, ...], to: object, said: str) -> None:
    manifest = json.loads((run / "run.json").read_text())
    put(manifest, *where, to=to)
    (run / "run.json").write_text(json.dumps(manifest))
    assert said in refusal(claims_of, run)


def test_a_run_whose_manifest_never_ends(run: Path) -> None:
    (run / "run.json").unlink()
    os.mkfifo(run / "run.json")
    assert "is a pipe" in refusal(claims_of, run)


@pytest.mark.parametrize("name", ["规划器v2", "Планировщик-2", "مخطط", "idm e (5 m/s²)", "ドライバー"])
def test_names_of_any_language_are_taken(honest: Make, tmp_path: Path, name: str) -> None:
    path = tmp_path / "x.json"
    made = honest("idm")
    path.write_text(replace(made, title=name, planner=replace(made.planner, name=name)).to_json())
    assert read_submission(path).planner.name == name


def test_no_claim_turns_isolation_off(honest: Make, tmp_path: Path) -> None:
    """Nor on: what is driven beside the referee is the verifier's choice alone, and the record tells it."""
    path = tmp_path / "x.json"
    for claimed, shared in ((None, False), ({"namespaces": "bubblewrap"}, True)):
        path.write_text(honest("idm", isolation=claimed).to_json())
        found = verify(claim_of(path), None, shared_process=shared, **DRAW)  # type: ignore[arg-type]
        assert (found.verdict, found.isolated) == (ClaimVerdict.CONFIRMED, not shared)
        assert found.good is not shared
    path.write_text(honest("idm", device="cuda").to_json())
    with pytest.raises(
        InputError, match=r"was driven on cuda, and isolated planners run on the CPU: .*--shared-process"
    ):
        verify(claim_of(path), None, **DRAW)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="'exe:x' is driven isolated only"):
        verify(claim_of(path), "exe:x", shared_process=True, **DRAW)  # type: ignore[arg-type]


def test_an_isolated_planner_names_its_files(honest: Make, tmp_path: Path) -> None:
    """Where it names none, any that lie beside its code would be shown to it and be in no hash."""
    path = tmp_path / "x.json"
    made = honest("idm")
    planner = replace(made.planner, spec="mine.py:P", code_sha256="0" * 64)
    path.write_text(replace(made, planner=planner, isolation={"namespaces": "bubblewrap"}).to_json())
    assert "none of its files is named" in refusal(read_submission, path)
    named = replace(planner, files=(f"{'0' * 64} 644  mine.py",))
    path.write_text(replace(made, planner=named, isolation={"namespaces": "bubblewrap"}).to_json())
    assert read_submission(path).planner == named


def test_no_claim_has_other_files_of_this_machine_read(
    honest: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor does it learn whether a guess at their content is right; and none is read that never ends."""
    monkeypatch.setenv("HOME", str(tmp_path))
    folder = tmp_path / "mine"
    folder.mkdir()
    (folder / "mine.py").write_text("")
    for place in (folder, tmp_path):
        (place / "secret").write_text("known")
    with (folder / "endless").open("wb") as sparse:
        sparse.truncate(1 << 40)
    told = sha256_of(tmp_path / "secret")
    user = pwd.getpwuid(os.getuid()).pw_name
    names = ("secret", "../secret", f"~{user}/secret", "endless", "../../../../../../../../../proc/kmsg")
    planner = replace(honest("idm").planner, opened=tuple(f"{told}  {name}" for name in names))
    assert set(changed_files(f"{folder}/mine.py:P", planner)) == {*names} - {"secret"}


@pytest.mark.parametrize(
    ("change", "strange"),
    [
        (lambda rows: [{**row, "scenario_id": f"x{row['scenario_id']}"} for row in rows if row["scd"]], "all"),
        (lambda rows: [*rows, {**rows[0], "scenario_id": "x"}], "1"),
    ],
    ids=["all", "one"],
)
def test_episodes_of_no_row_of_the_split_refute_a_run(
    run: Path, released: str, change: Callable[[list[Json]], list[Json]], strange: str
) -> None:
    """None of them can be drawn, so none would ever be wrong."""
    change_rows(run, change)
    (claim, *_) = claims_of(run)
    found = verify(claim, None, **DRAW)  # type: ignore[arg-type]
    assert found.verdict is ClaimVerdict.REFUTED
    count = len(claim.episodes) if strange == "all" else 1
    assert f"{count} of its episodes are of no row of dev: x" in found.differences[0].what


@pytest.mark.parametrize(
    ("changes", "said"), [({}, "stands twice"), ({"scd": True, "outcome": "collision"}, "contradicts")]
)
def test_no_run_writes_such_rows(run: Path, changes: Json, said: str) -> None:
    change_rows(run, lambda rows: [{**rows[0], **changes}, *rows[bool(changes) :]])
    assert said in refusal(claims_of, run)


# What a claim may call its planner where somebody else's package is installed.
NAMED = ("strange", "strang", "strange-e", "strange:P", "strange:Nobody", "no.such:P", "idn")


def test_no_name_has_an_installed_package_run_here(tmp_path: Path) -> None:
    mark = tmp_path / "ran"
    (tmp_path / "strange.py").write_text(f"open({str(mark)!r}, 'w')\nclass P: pass\n")
    told = tmp_path / "strange-1.dist-info"
    told.mkdir()
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: strange\nVersion: 1\n")
    (told / "entry_points.txt").write_text("[tsbench.planners]\nstrange = strange:P\n")
    code = f"""if True:
        from tsbench.core.errors import InputError
        from tsbench.board.isolation.isolated_loading import describe
        for name in {NAMED}:
            try:
                print(describe(name))
            except InputError as refused:
                print(refused)
    """
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=HANG_S,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
    )  # fmt: skip
    assert "did you mean strange" in done.stdout
    assert not mark.exists()
