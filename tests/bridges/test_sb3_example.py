"""The policy that comes with the guide reads limits: it passes pairs, and none without plates."""

from __future__ import annotations

from pathlib import Path

import pytest

import tsbench

PLANNER = f"{Path(tsbench.__file__).parent.parent}/examples/sb3_speed/planner.py:Policy"
# Twice what `coin`, the best floor, has of the same pairs of dev.
TWICE_COIN = 2 * 17.5


@pytest.mark.slow
@pytest.mark.parametrize("masked", [False, True])
def test_it_passes_pairs_by_reading(masked: bool, tmp_path: Path) -> None:
    episodes = tsbench.evaluate(
        [PLANNER], split="dev", types=["speed"], variants="one-per-map", mask_signs=masked, workers=1,
        out=tmp_path / "run", trace="none",
    ).episodes  # fmt: skip
    assert not episodes.error.notna().any()
    halves = episodes.groupby("pair_id").scd
    assert len(halves) == 20
    assert set(halves.size()) == {2}
    share = 100.0 * halves.all().mean()
    assert share == 0.0 if masked else share > TWICE_COIN
