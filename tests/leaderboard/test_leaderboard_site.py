"""The site of submissions: who stands where, and what is refused."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from tsbench.cli import main
from tsbench.core.errors import InputError
from tsbench.leaderboard.site import build_site
from tsbench.leaderboard.submission import Submission
from tsbench.leaderboard.verify import Difference, Verification

Make = Callable[..., Submission]


def put(folder: Path, name: str, submission: Submission) -> str:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(submission.to_json(), encoding="utf-8")
    return hashlib.sha256(path.read_bytes()).hexdigest()


def record(of: str, **changes: object) -> Verification:
    plain = Verification(
        of, "t", "alice", "2026-01-02", "0.1.0", 7, 2, ("a", "b"), 2, (), "", (), {}, {"processor": "x"}
    )
    return replace(plain, **changes)  # type: ignore[arg-type]


def order(page: str) -> list[str]:
    return re.findall(r'<th scope="row"><a href="([a-z-]+)-[0-9a-f]{8}\.html">', page)


def test_rows_stand_by_paired_scd_and_refuted_ones_last(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    put(base, "a/idm.json", honest("idm", note="Reads <b>nothing</b>."))
    good = put(base, "b/e.json", honest("idm-e", title="Expert", third_party=True))
    (base / "b" / "alice.json").write_text(record(good).to_json())
    assert build_site(base, out) == 2
    page = (out / "index.html").read_text()
    assert order(page) == ["expert", "idm"]
    assert "confirmed" in page
    assert "third-party" in page
    assert "2026.2, dev split" in page
    (own,) = out.glob("idm-*.html")
    assert "Reads &lt;b&gt;nothing&lt;/b&gt;." in own.read_text()
    assert "Nobody yet." in own.read_text()
    # One who finds it otherwise is enough.
    wrong = record(good, verifier="bob", equal=1, differences=(Difference("b", "verdict is another"),))
    (base / "b" / "bob.json").write_text(wrong.to_json())
    build_site(base, out)
    page = (out / "index.html").read_text()
    assert order(page) == ["idm", "expert"]
    (theirs,) = out.glob("expert-*.html")
    assert "Refuted" in theirs.read_text()
    assert "verdict is another" in theirs.read_text()


def test_titles_are_no_markup(honest: Make, tmp_path: Path) -> None:
    put(tmp_path / "all", "x.json", honest("idm", title="<script>alert(1)</script>"))
    build_site(tmp_path / "all", tmp_path / "site")
    for path in (tmp_path / "site").iterdir():
        assert "<script>alert" not in path.read_text()


def test_what_does_not_belong_is_refused(honest: Make, tmp_path: Path) -> None:
    base, out = tmp_path / "all", tmp_path / "site"
    made = honest("idm")
    digest = put(base, "idm.json", made)
    forged = replace(made, figures=(replace(made.figures[0], value=99.0), *made.figures[1:]))
    put(base, "forged.json", forged)
    with pytest.raises(InputError, match=r"forged\.json: its figures do not follow from its episodes"):
        build_site(base, out)
    (base / "forged.json").unlink()
    # A submission that was changed after somebody verified it has lost the record.
    (base / "v.json").write_text(record(digest).to_json())
    put(base, "idm.json", replace(made, note="better now"))
    with pytest.raises(InputError, match=r"v\.json: is of a submission that is not below"):
        build_site(base, out)
    (base / "v.json").write_text('{"kind": "else"}')
    with pytest.raises(InputError, match="neither a submission nor"):
        build_site(base, out)
    with pytest.raises(InputError, match="no such folder"):
        build_site(tmp_path / "none", out)


def test_data_that_are_not_here_are_said(honest: Make, tmp_path: Path) -> None:
    put(tmp_path / "all", "x.json", replace(honest("idm"), contract="0" * 64))
    build_site(tmp_path / "all", tmp_path / "site")
    (own,) = (tmp_path / "site").glob("idm-*.html")
    assert "The data of its contract are not here" in own.read_text()


def test_from_the_command_line(
    run: Path,
    released: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> tuple[int, str]:
        monkeypatch.setattr("sys.argv", ["tsbench", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return int(ended.value.code or 0), capsys.readouterr().out

    code, said = call("submit", str(run), "--planner", "idm-e", "--authors", "us")
    assert (code, "idm-e-dev.json: idm-e, 108 episodes" in said) == (0, True)
    draw = ("--sample", "3", "--seed", "1", "--by", "me", "--workers", "1")
    code, said = call("verify", "idm-e-dev.json", *draw, "--out", "record.json")
    assert (code, said.splitlines()[-1]) == (0, "confirmed")
    code, said = call("verify", "idm-e-dev.json", *draw, "--planner", "idm")
    assert (code, said.splitlines()[-1]) == (1, "refuted")
    (tmp_path / "board").mkdir()
    for name in ("idm-e-dev.json", "record.json"):
        (tmp_path / name).rename(tmp_path / "board" / name)
    code, said = call("leaderboard", "build", "board", "--out", "site")
    assert (code, "1 rows" in said, (tmp_path / "site/index.html").is_file()) == (0, True, True)
    assert released in (tmp_path / "site/index.html").read_text()
