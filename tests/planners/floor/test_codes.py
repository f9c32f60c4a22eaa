"""`codes`: whose way plates call for, what it is not told apart by, and how plates of scenes are counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest
from planner_loop import long_road, plate

from tsbench.cli.train import count_plates, write_counts
from tsbench.core.files import sha256_of
from tsbench.planners.base import Control
from tsbench.planners.floor import guess
from tsbench.planners.floor.guess import Blind, Codes, Plate, counts, read_counts, signed_odds
from tsbench.planners.idm import Idm
from tsbench.planners.observation import Observation
from tsbench.scenarios.data_set import DataSet

# Of the counts by which `codes` has the figures of docs/floor.md; other counts are another driver.
PUBLISHED = "d22da81a884cfc5e841bcc389ffd3ad4c3a31eaa125f5771d8bc2bee762a3c6f"
# By the published counts one stands in signed halves more often, the other in contrast halves.
SIGNED, CONTRAST = ("5.19", None), ("3.24", 30.0)
# Those of the priority types stand in both halves of the train split alike.
PRIORITY = {
    ("2.5", None): (800, 800),
    ("2.3.1", None): (400, 400),
    ("2.3.2", None): (380, 380),
    ("2.3.3", None): (380, 380),
}
COUNTED: dict[Plate, tuple[int, int]] = {("2.5", None): (9, 0), ("2.1", None): (4, 4), ("3.24", 70.0): (0, 9)}


@pytest.mark.parametrize(
    ("plates", "odds"),
    [
        ([], 0.0),
        ([("2.1", None)], 0.0),
        ([("2.5", None)], 2.302585),
        ([("2.5", None), ("2.5", None)], 2.302585),
        ([("3.24", 70.0)], -2.302585),
        ([("2.5", None), ("3.24", 70.0)], 0.0),
        ([("3.24", 60.0)], 0.0),
    ],
)
def test_plates_in_sight_vote(plates: list[Plate], odds: float) -> None:
    """Each kind of plate once; one that no half has says nothing."""
    assert signed_odds(plates, COUNTED) == pytest.approx(odds)


def test_it_drives_as_blind_or_as_idm() -> None:
    """A plate of signed halves makes it slow, one of contrast halves does not; a post says nothing."""
    signed, contrast = plate(*SIGNED), plate(*CONTRAST)
    slow, fast = (long_road(signed).run(d, 8.0).controls for d in (Blind(), Idm()))
    assert slow != fast
    assert long_road(signed).run(Codes(), 8.0).controls == slow
    assert long_road(contrast).run(Codes(), 8.0).controls == fast
    assert long_road(contrast.masked()).run(Codes(), 8.0).controls == slow


def test_a_plate_from_behind_leaves_it_undecided() -> None:
    """Which of two plates faces it would say which of them is its own."""
    front, back = plate(*CONTRAST), replace(plate(*SIGNED, 120.0), outline="rectangle").from_behind()
    for plates, obeys in (((front,), False), ((front, back), None)):
        driver = Codes()
        long_road(*plates).run(driver, 0.5)
        assert driver.obeys is obeys


def test_where_a_plate_stands_is_nothing_to_it() -> None:
    """The same plates on each other's posts: the same drive."""
    drives = [
        long_road(plate(*a, 130.0), plate(*b, 145.0)).run(Codes(), 8.0).controls
        for a, b in ((SIGNED, CONTRAST), (CONTRAST, SIGNED))
    ]
    assert drives[0] == drives[1]


class Later(Codes):
    """Reads another plate from 0.5 s on."""

    def act(self, observation: Observation) -> Control:
        late = observation.time > 0.5
        return super().act(replace(observation, signs=(plate(*SIGNED),)) if late else observation)


def test_the_first_plates_in_sight_decide() -> None:
    contrast = plate(*CONTRAST)
    assert long_road(contrast).run(Later(), 8.0).controls == long_road(contrast).run(Codes(), 8.0).controls


def of_priority(counted: Mapping[Plate, tuple[int, int]]) -> dict[Plate, tuple[int, int]]:
    return {plate: n for plate, n in counted.items() if plate[0].startswith(("2.3.", "2.5"))}


def test_the_counts_that_it_drives_by_are_those_that_it_was_published_with() -> None:
    assert of_priority(counts()) == PRIORITY
    signed, contrast = (counts()[one] for one in (SIGNED, CONTRAST))
    assert signed[0] > signed[1]
    assert contrast[0] < contrast[1]
    assert sha256_of(Path(guess.__file__).with_name("codes.csv")) == PUBLISHED


def test_counts_are_those_of_the_scenes(tmp_path: Path) -> None:
    """Of one priority type; what is written is read again."""
    rows = [row for row in DataSet().table("train") if row.pair_type == "stop"]
    found = count_plates(rows)
    assert of_priority(found) == {("2.5", None): PRIORITY["2.5", None]}
    write_counts(found, tmp_path / "codes.csv")
    assert read_counts(tmp_path / "codes.csv") == found
