"""`--planner` taken apart: images, programs, experts."""

from __future__ import annotations

import pytest

from tsbench.core.errors import InputError
from tsbench.planners.planner_spec import PlannerSpec


def test_a_specification_carries_its_image() -> None:
    spec = PlannerSpec.parse("mine.py:Mine").in_image("host:5000/me/planner@sha256:1f")
    assert str(spec) == "image:host:5000/me/planner@sha256:1f mine.py:Mine"
    assert PlannerSpec.parse(str(spec)) == spec
    assert PlannerSpec.parse("mine.py:Mine") == PlannerSpec("mine.py:Mine", None)
    with pytest.raises(InputError, match="names an image already"):
        spec.in_image("other")


@pytest.mark.parametrize("written", ["image:--privileged mine.py:Mine", "image:-v=/:/host x", "image: x", "image:"])
def test_an_option_is_no_image(written: str) -> None:
    with pytest.raises(InputError, match="is no name of an image"):
        PlannerSpec.parse(written)


@pytest.mark.parametrize("image", ["", "a b", "--privileged"])
def test_what_is_no_name_is_no_image(image: str) -> None:
    with pytest.raises(InputError, match="is no name of an image"):
        PlannerSpec("idm").in_image(image)


def test_programs_and_images_are_isolated_only() -> None:
    assert [PlannerSpec.parse(one).isolated_only for one in ("idm-e", "exe:./a", "image:b idm")] == [False, True, True]
    assert PlannerSpec("mine.py:Mine-e").base == "mine.py:Mine"
    assert PlannerSpec("idm").program is None
    with pytest.raises(InputError, match="no file that can be executed"):
        PlannerSpec("exe:/no/such").executable()
