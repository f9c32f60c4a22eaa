"""Who drives a submission again finds what is not as submitted, and confirms what is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import hostile
import pytest
from submitted import TOWN

import tsbench
from tsbench.board.claim import claim_of, claims_of
from tsbench.board.submission import Submission, SubmittedEpisode, figures_of
from tsbench.board.verification import ClaimVerdict, Verification, draw, read_verification, verify
from tsbench.core.errors import InputError
from tsbench.episode.perception_level import EXACTLY
from tsbench.scenarios.data_set import DataSet

Make = Callable[..., Submission]
CONFIRMED, REFUTED = ClaimVerdict.CONFIRMED, ClaimVerdict.REFUTED
OPTIONS = {"sample": 2, "seed": 3, "verifier": "me", "workers": 1, "on_progress": lambda *_: None}
NO_HASHES = [f"{k:032x}" for k in range(1, 2000)]


def check(folder: Path, submission: Submission, planner: str | None = None, **more: object) -> Verification:
    """Beside the referee, which has the bytes of an isolated drive in a fraction of its time."""
    path = folder / "submission.json"
    path.write_text(submission.to_json(), encoding="utf-8")
    return verify(claim_of(path), planner, **{**OPTIONS, "shared_process": True, **more})  # type: ignore[arg-type]


def whats(found: Verification) -> str:
    return "; ".join(difference.what for difference in found.differences)


def with_figures(submission: Submission) -> Submission:
    table = DataSet(TOWN).table("dev")
    figures = figures_of(submission.episodes, table, submission.planner, submission.contract)
    return replace(submission, figures=figures)


def test_an_honest_one_is_confirmed_byte_for_byte(honest: Make, tmp_path: Path) -> None:
    found = check(tmp_path, honest("idm-e"), shared_process=False)
    assert (found.verdict, found.equal, len(found.driven), found.explained) == (CONFIRMED, 2, 2, ())
    assert found.arithmetic_differences == ()
    assert found.good
    (tmp_path / "record.json").write_text(found.to_json())
    assert read_verification(tmp_path / "record.json") == found
    # A record that contradicts itself is none.
    for said in ("refuted", "verdicts equal, bytes not comparable", "fine"):
        text = found.to_json().replace('"verdict": "confirmed"', f'"verdict": "{said}"')
        (tmp_path / "record.json").write_text(text)
        with pytest.raises(InputError, match=f"says '{said}', by its counts it is confirmed"):
            read_verification(tmp_path / "record.json")
    # The draw is the verifier's: by the seed, and nothing else.
    (tmp_path / "idm.json").write_text(honest("idm").to_json())
    claim, table = claim_of(tmp_path / "idm.json"), DataSet(TOWN).table("dev")
    drawn = [tuple(row.scenario_id for row in draw(claim.contract, claim.episodes, table, 2, seed)) for seed in (3, 4)]
    assert drawn[0] == found.driven != drawn[1]


def test_verdicts_that_were_turned_are_found(honest: Make, tmp_path: Path) -> None:
    turned = tuple(
        e if e.scd else SubmittedEpisode(e.scenario_id, "arrived", True, (), no_hash)
        for e, no_hash in zip(honest("idm").episodes, NO_HASHES, strict=False)
    )
    forged = with_figures(replace(honest("idm"), episodes=turned))
    assert forged.figures[0].value == 100.0
    found = check(tmp_path, forged, sample=6)
    assert found.verdict is REFUTED
    assert "verdict is arrived, passed as submitted" in whats(found)


def test_a_figure_without_its_episodes_is_found(honest: Make, tmp_path: Path) -> None:
    made = honest("idm")
    first, second, *others = made.figures
    found = check(tmp_path, replace(made, figures=(replace(first, value=99.0), *others)), sample=1)
    assert whats(found).startswith("paired_scd of all is (99.0,")
    assert f"{second.figure} of {second.over} is missing" in whats(found)


def test_who_changed_the_referee_in_a_shared_process_is_found(tmp_path: Path) -> None:
    """The verifier isolates it, and there is no referee to change."""
    cheat = f"{hostile.__file__}:PatchesEnding"
    tsbench.evaluate(cheat, split="dev", types=["main_road"], limit=2, workers=1, out=tmp_path / "run")
    (claim,) = claims_of(tmp_path / "run")
    assert {episode.outcome for episode in claim.episodes} == {"arrived"}
    beside = verify(claim, None, shared_process=True, **OPTIONS)  # type: ignore[arg-type]
    assert (beside.verdict, beside.isolated, beside.good) == (CONFIRMED, False, False), "else this cheat proves nothing"
    found = verify(claim, None, **{**OPTIONS, "sample": 1})  # type: ignore[arg-type]
    assert (found.verdict, found.isolated, found.equal) == (REFUTED, True, 0)
    assert "verdict is arrived" in whats(found)


def test_another_planner_and_other_weights_are_found(honest: Make, tmp_path: Path) -> None:
    found = check(tmp_path, honest("idm"), "blind", sample=1)
    assert "the planner is called idm as submitted, blind here" in whats(found)
    assert "the planner's floor is False as submitted, True here" in whats(found)
    weights = replace(honest("idm"), planner=replace(honest("idm").planner, weights_sha256="f" * 64))
    assert (
        whats(check(tmp_path, weights, sample=1))
        == "the planner's weights_sha256 is ffffffffffff as submitted, None here"
    )


def test_another_arithmetic_explains_other_bytes_but_no_other_verdict(honest: Make, tmp_path: Path) -> None:
    made = honest("idm")
    others = tuple(replace(episode, digest=no_hash) for episode, no_hash in zip(made.episodes, NO_HASHES, strict=False))
    same = check(tmp_path, replace(made, episodes=others))
    assert same.verdict is REFUTED
    assert "on the same arithmetic" in whats(same)
    answers = {**made.arithmetic["answers"], "libm": "f" * 16}
    elsewhere = replace(made, arithmetic={**made.arithmetic, "answers": answers})
    found = check(tmp_path, replace(elsewhere, episodes=others))
    assert (found.verdict, found.equal, found.explained) == (ClaimVerdict.VERDICTS_ONLY, 0, found.driven)
    (why,) = found.arithmetic_differences
    assert why.startswith("the arithmetic of libm is another")
    # Its own word is all that explains so much.
    assert not found.good
    turned = tuple(replace(e, outcome="timeout" if e.scd else "arrived", scd=not e.scd, clauses=()) for e in others)
    found = check(tmp_path, with_figures(replace(elsewhere, episodes=turned)))
    assert (found.verdict, len(found.differences), found.explained) == (REFUTED, 2, ())


def test_another_contract_is_refused(honest: Make, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="its contract is 000000000000, that of this tsbench"):
        check(tmp_path, replace(honest("idm"), contract="0" * 64))


def test_a_run_of_part_of_a_split_is_driven_again_as_it_was(tmp_path: Path) -> None:
    """With its planners, masked plates and perception level."""
    run = tmp_path / "run"
    options = {"split": "dev", "types": ["speed_limit"], "limit": 2, "out": run, "workers": 1, "perception": "poor"}
    tsbench.evaluate(["idm", "reader"], **options)  # type: ignore[arg-type]
    idm, reader = claims_of(run)
    assert len(idm.episodes) == len(reader.episodes) == 2
    told: dict[str, object] = {**OPTIONS, "sample": 99}
    found = verify(reader, None, **told)  # type: ignore[arg-type]
    assert (found.verdict, found.equal, found.explained) == (CONFIRMED, 2, ())
    # Other eyes read other plates: who leaves the level out does not find what the run says.
    for eyes in (EXACTLY, replace(reader.perception, masked=True)):
        found = verify(replace(reader, perception=eyes), None, shared_process=True, **told)  # type: ignore[arg-type]
        assert found.verdict is REFUTED
