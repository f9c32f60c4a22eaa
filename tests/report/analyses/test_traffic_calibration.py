"""Which cars of a trace count as background traffic, and when a run's calibration is not told."""

from __future__ import annotations

from pathlib import Path

import episode_builders as made
import numpy as np
import page_runs
import pytest

from tsbench.episode.trace import read_trace, write_trace
from tsbench.metrics.calibration import calibrate
from tsbench.report.analyses.run_pool import index_episodes, read_pool
from tsbench.report.analyses.traffic_calibration import background_speeds, traffic, unjudged


def test_moving_background_cars_every_half_second(tmp_path: Path) -> None:
    tracks = [
        made.Track("bg_1", made.straight(41, 100.0, 1.6, 0.0, 8.0)),
        made.Track("bg_standing", made.straight(41, 200.0, 1.6, 0.0, 0.0)),
        made.Track("convoy_0", made.straight(41, 150.0, 1.6, 0.0, 5.0)),
    ]
    egos = [made.ego(60.0 + k, speed=10.0) for k in range(41)]
    write_trace(tmp_path / "t", made.result(made.facts(egos, tracks)))
    assert background_speeds([read_trace(tmp_path / "t")]) == pytest.approx([8.0] * 9)
    alone = made.result(made.facts(egos))
    write_trace(tmp_path / "alone", alone)
    assert len(background_speeds([read_trace(tmp_path / "alone")])) == 0
    assert background_speeds([]).dtype == np.float64


def test_a_part_of_a_split_is_not_judged() -> None:
    values = np.linspace(1.0, 12.0, 40)
    judged = calibrate(values, values, values / 10)
    assert [fit.good is None for fit in judged] == [False, True, False]
    plain = unjudged(judged)
    assert [fit.good for fit in plain] == [None, None, None]
    assert [fit.distance for fit in plain] == [fit.distance for fit in judged]


def test_scenarios_of_another_contract_have_none(tmp_path: Path) -> None:
    pool = read_pool([page_runs.make_run(tmp_path / "run")], False)
    assert traffic(pool, index_episodes(pool)) is None
