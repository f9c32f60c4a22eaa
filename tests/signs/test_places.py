"""The table of places: a wrong one is one line, and a road without a class allows any speed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tsbench.core.errors import InputError
from tsbench.signs.places import load_places


def test_a_ramp_has_the_speeds_of_its_road() -> None:
    table = load_places()
    ramp, road = (
        table.allowed_speeds(road_class=f"highway.{name}", code="5.31") for name in ("primary_link", "primary")
    )
    assert ramp == road == (40.0, 50.0)
    assert table.allowed_speeds(road_class="highway.primary", code="5.21") == ()
    assert table.allowed_speeds(road_class="", code="5.21") is None


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('living_street: {"3.24": [20]', 'living_street: {"3.24": [25]', "3.24: the sign sets no 25"),
        ('living_street: {"3.24": [20]', 'living_street: {"2.1": [20]', "2.1: no sign with a value"),
    ],
)
def test_a_wrong_table_is_one_line(edited: Callable[[str, str, str], Path], old: str, new: str, says: str) -> None:
    with pytest.raises(InputError, match=r"places\.yaml: ") as caught:
        load_places(edited("places.yaml", old, new))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)
