"""Code that was changed keeps its edition only where scenes and results are the same bytes."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
import yaml
from own_copy import ROOT, make_copy

from tsbench.core.errors import InputError
from tsbench.core.paths import OWN_CITY
from tsbench.run.contract import code_hash
from tsbench.run.edition import contract_now
from tsbench.run.planner_info import describe
from tsbench.tools.same_edition import check_data, checked_out, commits_of, compare_states, compared_with

EDITIONS = "tsbench/run/editions.yaml"
FIRST, SECOND = "a" * 64, "b" * 64


def state(folder: Path, file: str = "", old: str = "", new: str = "") -> Path:
    """A copy of this clone with all its scenes, and one change."""
    root = make_copy(folder).root
    for path in (ROOT / "scenarios").iterdir():
        if not (root / "scenarios" / path.name).exists():
            (root / "scenarios" / path.name).symlink_to(path)
    if file:
        text = (root / file).read_text()
        assert text.count(old) == 1
        (root / file).write_text(text.replace(old, new))
    return root


def compared(
    tmp_path: Path, *change: str, planners: tuple[str, ...] = ("idm",)
) -> tuple[int, tuple[str, ...], str]:
    found = compare_states(
        state(tmp_path / "earlier"), state(tmp_path / "now", *change), tmp_path, planners, limit=2
    )
    return found.episodes, found.planners, found.digest


def test_a_rewritten_line_gives_the_same_bytes(tmp_path: Path) -> None:
    episodes, planners, digest = compared(
        tmp_path, "tsbench/sim/ego.py", "from __future__ import annotations\n",
        "from __future__ import annotations\n\nUNUSED = 1\n",
    )  # fmt: skip
    assert (episodes, planners, len(digest)) == (2, ("idm",), 64)


def test_a_rewritten_planner_is_entered_with_both_codes(tmp_path: Path) -> None:
    line = "from __future__ import annotations\n"
    now = state(tmp_path / "now", "tsbench/planners/floor/guess.py", line, f"{line}\nUNUSED = 1\n")
    found = compare_states(ROOT, now, tmp_path, ("idm", "coin"), limit=2)
    assert found.codes.keys() == {"coin"}
    assert found.codes["coin"][0] == describe("coin").code_sha256 != found.codes["coin"][1]


def test_another_figure_in_a_record_is_another_edition(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"idm: \S+: episodes.parquet differs: this is another edition"):
        compared(tmp_path, "tsbench/metrics/comfort.py", "(-4.05, 2.40)", "(-4.05, 0.01)")


def test_another_motion_is_another_edition(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"idm: .* differs: this is another edition"):
        compared(tmp_path, "tsbench/sim/ego.py", "MAX_SPEED_MPS = 22.2", "MAX_SPEED_MPS = 8.0")


def test_a_planner_that_only_the_new_state_has_is_left_out_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.py").write_text(
        "from tsbench import Control\ndef mine(o):\n    return Control(0.0, 0.0)\n"
    )
    with pytest.raises(InputError, match="nothing was compared"):
        compared(tmp_path, planners=("nobody",))
    assert "nobody: not compared: " in capsys.readouterr().out


def test_contracts_of_other_scenes_are_refused() -> None:
    check_data({OWN_CITY: {"dev": contract_now("dev")}}, code_hash())
    for contract, code in ((contract_now("dev"), FIRST), (contract_now("test"), code_hash())):
        with pytest.raises(
            InputError, match="moscow dev: scenes, signs or versions of packages are not those"
        ):
            check_data({OWN_CITY: {"dev": contract}}, code)


@pytest.fixture
def history(tmp_path: Path) -> tuple[Path, list[str]]:
    """A repository whose contract was FIRST, then SECOND with FIRST under `same`; its commits."""
    root = tmp_path / "repository"
    (root / EDITIONS).parent.mkdir(parents=True)

    def git(*arguments: str) -> str:
        name = ("-c", "user.name=x", "-c", "user.email=x@y")
        return subprocess.run(
            ["git", *name, *arguments], cwd=root, check=True, capture_output=True, text=True
        ).stdout

    git("init", "-q")
    commits = []
    for released, same in ((FIRST, []), (FIRST, []), (SECOND, [{"contracts": {"dev": FIRST}}])):
        table = [{"name": "1", "released": {"0": {"dev": "c" * 64}}}]
        table.append({"name": "2", "released": {"0": {"dev": released}}, "same": same})
        (root / EDITIONS).write_text(yaml.safe_dump(table))
        (root / "tsbench" / "other.txt").write_text(str(len(commits)))
        git("add", "-A")
        git("commit", "-q", "-m", "x")
        commits.append(git("rev-parse", "HEAD").strip())
    return root, commits


def test_commits_are_those_that_released_the_contract(history: tuple[Path, list[str]]) -> None:
    root, commits = history
    assert list(commits_of(FIRST, root)) == [commits[1], commits[0]]
    assert list(commits_of(SECOND, root)) == [commits[2]]
    assert list(commits_of("c" * 64, root)) == list(commits_of("d" * 64, root)) == []


def test_a_contract_of_no_commit_is_refused() -> None:
    with pytest.raises(InputError, match=f"no commit here is of the contract {SECOND}"):
        compared_with(SECOND, (), 1)


def test_a_state_is_there_for_as_long_as_it_is_compared(history: tuple[Path, list[str]]) -> None:
    root, commits = history
    with checked_out(commits[0], root) as place:
        assert (place / "tsbench" / "other.txt").read_text() == "0"
    assert not place.exists()
    listed = subprocess.run(
        ["git", "worktree", "list"], cwd=root, check=True, capture_output=True, text=True
    ).stdout
    assert len(listed.splitlines()) == 1
