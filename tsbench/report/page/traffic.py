"""How near the traffic that a run drove through comes to nuPlan's, as far as its traces tell.

`tsbench scenarios calibration` drives scenes anew to see all cars. A report takes what is there: initial speeds of the
run's scenarios, realised densities from their certificates, and speeds of cars in sight of the ego in traced episodes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from tsbench.dataset.scenes.calibration import (
    MOVING_MPS,
    SPEEDS_EVERY_TICKS,
    SPEEDS_OVER_S,
    Fit,
    calibrate,
    grid_speeds,
    sample_rows,
)
from tsbench.episode.trace import Trace, read_trace
from tsbench.geometry.polyline import Array
from tsbench.report.analyses.calibration import calibration
from tsbench.report.analyses.model import Analysis
from tsbench.report.analyses.pool import RunPool
from tsbench.report.page.episode_index import EpisodeIndex
from tsbench.run.contract import contract_hash
from tsbench.run.edition import standing_contract
from tsbench.scenarios.certificates import certificates_path, read_certificates
from tsbench.scenarios.table import read_table, table_path
from tsbench.signs.catalog import load_catalog
from tsbench.sim.world import DT_S

_EPISODES = 40
_BACKGROUND = "bg_"


def traffic(pool: RunPool, index: EpisodeIndex) -> Analysis | None:
    """The calibration of a pool's traffic; None where it cannot be told.

    That is so for scenarios that are not those of this tsbench, without certificates, or without traced traffic.
    """
    split = str(pool.runs[0].manifest["effective"]["split"])
    path = table_path(split)
    if not path.is_file() or not certificates_path().is_file():
        return None
    table = read_table(path)
    if standing_contract(contract_hash(table, load_catalog())) != pool.contract:
        return None
    driven = {row["scenario_id"] for row in index.rows}
    rows = [spec for spec in table if spec.scenario_id in driven]
    traced: dict[str, int] = {}
    for row in index.traces:
        traced.setdefault(index.rows[row]["scenario_id"], row)
    sample = sample_rows([spec for spec in rows if spec.scenario_id in traced], _EPISODES)
    cruise = background_speeds(read_trace(index.traces[traced[spec.scenario_id]]) for spec in sample)
    proven = (c for c in read_certificates(certificates_path()) if c.scenario_id in driven)
    densities = np.array([c.realised_density for c in proven if c.asked_density])
    initial = grid_speeds(rows)
    if not (len(initial) and len(cruise) and len(densities)):
        return None
    whole = len(rows) == len(table)
    fits = calibrate(initial, cruise, densities)
    share = split if whole else f"{len(rows):,} of {len(table):,} of the {split}"
    found = calibration(fits if whole else unjudged(fits), share)
    note = (
        f"only the {len(rows):,} scenarios of this page; cruise speed: moving background cars in sight of the ego in "
        f"the first {SPEEDS_OVER_S:.0f} s of {len(sample)} traced episodes, so a planner's own driving has a part in it"
    )
    return replace(found, notes=(note, *found.notes))


def unjudged(fits: Sequence[Fit]) -> list[Fit]:
    """The same without a verdict: the goal is one for the whole of a split, a part of it need not look like nuPlan."""
    return [replace(fit, at_probes=float("nan")) for fit in fits]


def background_speeds(traces: Iterable[Trace]) -> Array:
    """Speeds (m,) of moving background cars in sight, m/s, at the moments that the calibration looks at."""
    found = [np.zeros(0)]
    for trace in traces:
        names = trace.snapshots[-1].actors.table.ids
        background = np.array([name.startswith(_BACKGROUND) for name in names], dtype=bool)
        for snapshot in trace.snapshots[: round(SPEEDS_OVER_S / DT_S) : SPEEDS_EVERY_TICKS]:
            actors = snapshot.actors
            found.append(actors.speed[background[actors.index]] if len(actors) else np.zeros(0))
    speeds = np.concatenate(found)
    return speeds[(speeds >= MOVING_MPS[0]) & (speeds <= MOVING_MPS[1])]
