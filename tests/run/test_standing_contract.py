"""Contracts that were shown to give the same bytes: one edition, one table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

import tsbench
from tsbench.core.errors import InputError
from tsbench.run import edition
from tsbench.run.contract import mirrored_contract
from tsbench.run.edition import (
    Edition,
    SameResults,
    edition_of,
    editions,
    is_same_planner,
    release,
    standing_contract,
)
from tsbench.scenarios.table import splits_there

VERSION = tsbench.__version__
FIRST, SECOND, THIRD = ({"test": c * 64, "dev": c.upper() * 64} for c in "abc")


def state(contracts: dict[str, str]) -> SameResults:
    return SameResults(contracts, "0" * 64, "216 episodes")


def test_the_oldest_with_the_same_results_stands_for_all() -> None:
    made = Edition("2031.1", "", {VERSION: THIRD}, (state(FIRST), state(SECOND)))
    assert made.standing() == {
        **{one["test"]: FIRST["test"] for one in (FIRST, SECOND, THIRD)},
        **{one["dev"]: FIRST["dev"] for one in (FIRST, SECOND, THIRD)},
    }
    assert made.contracts() == {hash_ for one in (FIRST, SECOND, THIRD) for hash_ in one.values()}


def test_a_split_that_came_later_begins_with_itself() -> None:
    made = Edition("2031.1", "", {VERSION: {**SECOND, "train": "d" * 64}}, (state(FIRST),))
    assert made.standing()["d" * 64] == "d" * 64
    assert made.standing()[SECOND["dev"]] == FIRST["dev"]


def test_an_older_version_stands_for_itself() -> None:
    made = Edition("2031.1", "", {"0.0.1": FIRST, VERSION: THIRD}, (state(SECOND),))
    assert FIRST["test"] not in made.standing()
    assert FIRST["test"] in made.contracts()
    assert made.standing()[THIRD["test"]] == SECOND["test"]


@pytest.fixture
def entered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A table of editions whose last has the contracts FIRST."""
    path = tmp_path / "editions.yaml"
    path.write_text(yaml.safe_dump([{"name": "2031.1", "title": "x", "released": {VERSION: FIRST}}]))
    monkeypatch.setattr(edition, "PATH", path)
    monkeypatch.setattr(edition, "splits_there", lambda: ("test", "dev"))
    monkeypatch.setattr(edition, "earlier_splits", lambda: {})
    editions.cache_clear()
    yield path
    monkeypatch.undo()
    editions.cache_clear()


def released_as(
    monkeypatch: pytest.MonkeyPatch, contracts: dict[str, str], same: SameResults | None
) -> Edition:
    monkeypatch.setattr(edition, "contract_now", contracts.__getitem__)
    assert release(same) == contracts
    editions.cache_clear()
    return editions()[-1]


def test_states_are_entered_one_after_the_other(entered: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert released_as(monkeypatch, SECOND, state(FIRST)).same == (state(FIRST),)
    assert released_as(monkeypatch, SECOND, None).same == (state(FIRST),), "nothing has changed"
    last = released_as(monkeypatch, THIRD, state(SECOND))
    assert last.same == (state(FIRST), state(SECOND))
    for contracts in (FIRST, SECOND, THIRD):
        assert edition_of(contracts["test"]) == "2031.1"
        assert standing_contract(contracts["test"]) == FIRST["test"]
        assert standing_contract(mirrored_contract(contracts["test"])) == mirrored_contract(FIRST["test"])
    assert standing_contract("e" * 64) == "e" * 64


def test_a_planner_is_the_same_along_the_states_that_were_compared(
    entered: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    codes = [letter * 64 for letter in "def"]
    released_as(monkeypatch, SECOND, replace(state(FIRST), planners={"idm": codes[:2]}))
    last = released_as(monkeypatch, THIRD, replace(state(SECOND), planners={"idm": codes[1:]}))
    assert [one.planners for one in last.same] == [{"idm": codes[:2]}, {"idm": codes[1:]}]
    assert all(is_same_planner("idm", code, codes[2]) for code in codes)
    assert is_same_planner("idm", codes[0], codes[1])
    # Nothing is known of other planners and codes, nor in the other direction.
    assert not is_same_planner("blind", codes[0], codes[2])
    assert not is_same_planner("idm", "0" * 64, codes[2])
    assert not is_same_planner("idm", codes[2], codes[0])
    assert not is_same_planner("idm", None, codes[2])


def test_other_contracts_without_a_comparison_end_the_chain(
    entered: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    released_as(monkeypatch, SECOND, state(FIRST))
    assert released_as(monkeypatch, THIRD, None).same == ()
    assert standing_contract(SECOND["test"]) == SECOND["test"]
    assert edition_of(SECOND["test"]) == "2031.1+local"


def test_a_split_with_the_same_contract_keeps_what_was_compared(
    entered: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the scenes of one split are built anew, and the code stays."""
    released_as(monkeypatch, SECOND, state(FIRST))
    last = released_as(monkeypatch, {"test": SECOND["test"], "dev": THIRD["dev"]}, None)
    assert last.same == (state({"test": FIRST["test"]}),)
    assert standing_contract(SECOND["test"]) == FIRST["test"]
    assert standing_contract(THIRD["dev"]) == THIRD["dev"]
    assert edition_of(SECOND["dev"]) == "2031.1+local"


def test_only_the_state_entered_last_can_have_been_compared(
    entered: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(edition, "contract_now", THIRD.__getitem__)
    with pytest.raises(InputError, match="the state that was compared is not the one that was entered last"):
        release(state(SECOND))


def test_what_comes_with_tsbench_was_compared() -> None:
    """Whoever enters a state by hand leaves out how it was seen to be the same."""
    for made in editions():
        for earlier in made.same:
            assert set(earlier.contracts) <= set(splits_there())
            assert " episodes of dev by " in earlier.compared
