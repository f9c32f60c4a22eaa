"""Pairs in tables: two halves of one draw, side by side, with a certificate that says that they measure something."""

from __future__ import annotations

from dataclasses import replace

import pytest
from episode_builders import spec

from tsbench.make.scenes.verify import verify_certificates, verify_pairs
from tsbench.scenarios.certificates import Certificate
from tsbench.scenarios.spec import CONTRAST, ScenarioSpec

SIGNED = replace(spec("speed_limit-a-v0"), pair_id="speed_limit-a-v0")
OTHER = replace(
    SIGNED,
    scenario_id="speed_limit-a-v0-c",
    half=CONTRAST,
    sign_value=70.0,
    additional="v0c",
    additional_sha256="2" * 64,
)
SOUND = {"exclusive": True, "passed_by": "", "blind_equal": True, "differs_s": None, "brake_mps2": None}


def certificate(row: ScenarioSpec, **fields: object) -> Certificate:
    told = Certificate(
        scenario_id=row.scenario_id, scenario_type=row.scenario_type, split=row.split, attempt=0, expert="idm-e",
        expert_time_s=9.0, blind_baseline="idm", blind_outcome="arrived", tempting=True, engaged=True,
        asked_density=0.0, realised_density=0.0, road_users=0, overlaps=0, arrival_gap_s=0.0, error="", digest="",
        basis="", scoring=1, reproduced=None,
    )  # fmt: skip
    return replace(told, **{**SOUND, **fields})  # type: ignore[arg-type]


def problems(*rows: ScenarioSpec, **fields: object) -> list[tuple[str, str]]:
    return verify_pairs(rows, [certificate(row, **fields) for row in {r.scenario_id: r for r in rows}.values()])


def test_a_sound_pair_and_a_row_without_one() -> None:
    alone = replace(SIGNED, scenario_id="stop-a-v0", pair_id="")
    assert problems(SIGNED, OTHER, alone, exclusive=True) == []
    assert problems(SIGNED, OTHER, differs_s=4.0, brake_mps2=6.0) == []


@pytest.mark.parametrize("rows", [(SIGNED,), (OTHER,), (OTHER, SIGNED), (SIGNED, replace(SIGNED, scenario_id="x"))])
def test_halves_that_are_not_side_by_side(rows: tuple[ScenarioSpec, ...]) -> None:
    said = ("speed_limit-a-v0", "is not one signed row and, next to it, one contrast row")
    assert problems(*rows) == [said]
    alone = replace(SIGNED, scenario_id="stop-a-v0", pair_id="stop-a-v0")
    assert said in problems(SIGNED, alone, OTHER)


@pytest.mark.parametrize(
    ("name", "value"),
    [("variant", 1), ("split", "train"), ("seed", 8), ("layout", 1), ("horizon", 601), ("place", "p")],
)
def test_halves_of_two_draws(name: str, value: object) -> None:
    other = replace(OTHER, **{name: value})  # type: ignore[arg-type]
    assert problems(SIGNED, other) == [("speed_limit-a-v0", f"the halves differ in {name}")]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"exclusive": None}, "its halves were never compared"),
        ({"exclusive": False}, "one drive passes both halves"),
        ({"passed_by": "idm"}, "idm passes both halves"),
        ({"blind_equal": False}, "the halves differ in more than what the plates say"),
        ({"differs_s": 4.0, "brake_mps2": 5.9}, "who watches the others can still stop with 5.9 m/s2"),
    ],
)
def test_a_pair_that_measures_nothing(fields: dict[str, object], words: str) -> None:
    assert problems(SIGNED, OTHER, **fields) == [(row.scenario_id, words) for row in (SIGNED, OTHER)]


def test_only_the_signed_half_has_to_tempt() -> None:
    said = [(SIGNED.scenario_id, "idm keeps the rule of the signed half")]
    assert problems(SIGNED, OTHER, tempting=False) == said


def test_certificates_of_an_earlier_edition_are_not_asked_what_they_were_about() -> None:
    proofs = [certificate(SIGNED)]
    ((_, said),) = verify_certificates([SIGNED], proofs, ())
    assert "is of another row or SUMO" in said
    assert verify_certificates([SIGNED], proofs, {"test"}) == []
    assert verify_certificates([OTHER], proofs, {"test"}) == [
        (OTHER.scenario_id, "has no certificate (tsbench scenarios build makes it)")
    ]
