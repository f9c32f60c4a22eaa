"""The policy that comes with the guide reads limits: it passes pairs, and none without plates."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from tsbench.cli import cli

ROOT = Path(__file__).resolve().parents[2]
# Twice what `coin`, the best floor, has of the same pairs of dev.
TWICE_COIN = 2 * 17.5


@pytest.mark.slow
@pytest.mark.parametrize("masked", [False, True])
def test_it_passes_pairs_by_reading(masked: bool, tmp_path: Path) -> None:
    planner = f"{ROOT / 'examples' / 'sb3_speed' / 'planner.py'}:Policy"
    words = ["run", "--planner", planner, "--split", "dev", "--types", "speed", "--variants", "one-per-map"]
    words += ["--workers", "1", "--trace", "none", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(cli, [*words, *(["--mask-signs"] if masked else [])])
    assert done.exit_code == 0, done.output
    passed: dict[str, list[bool]] = {}
    for row in pq.read_table(tmp_path / "run" / "episodes.parquet").to_pylist():
        passed.setdefault(row["pair_id"], []).append(row["scd"])
    assert {len(halves) for halves in passed.values()} == {2}
    share = 100.0 * sum(map(all, passed.values())) / len(passed)
    assert len(passed) == 20
    assert share == 0.0 if masked else share > TWICE_COIN
