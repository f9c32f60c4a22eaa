"""Two planners compared over the same pairs and scenarios: differences, by type and group, and the pairs that flipped.

Source: docs/metrics.md, "Aggregation". Yes/no outcomes: exact McNemar, and a 95 % interval from those of the
shares of pairs that either side alone passed (Newcombe 1998, Statistics in Medicine 17, 2635-2650). Others: a cluster
bootstrap over places, drawn once for both. A difference that is not significant comes with the minimum detectable
effect. Strict and completed figures go together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from statistics import NormalDist

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from tsbench.core.errors import InputError
from tsbench.core.parquet import with_text
from tsbench.geometry.polyline import Array
from tsbench.metrics.breakdown import Mask, Scores, StrictAndCompleted, break_down
from tsbench.metrics.intervals import (
    LEVEL,
    MIN_CLUSTERS,
    ClusterBootstrap,
    part_weights,
    percentiles,
    share_interval,
    sums_by_cluster,
)
from tsbench.metrics.metric import Metric
from tsbench.metrics.records import Records, split_records
from tsbench.metrics.scd import SCD

ALPHA = 1 - LEVEL
POWER = 0.8
_ALIKE = 1e-12
_DIGITS = 9
# Tables ask for the same counts again and again, and a power takes a root finder.
_KEPT = 1 << 14


@dataclass(frozen=True, slots=True)
class Difference:
    """One figure of A and of B over the same pairs, and B - A. Numbers in the metric's unit, p in 0-1.

    a, b, value: None where no pair counts. low, high: None where there is no interval; `reason` says why. n: pairs;
    clusters: places they are at; parts: types that a macro mean is over (1 otherwise). won, lost: pairs that only B,
    only A has; p: exact McNemar; all three None for what is not yes/no. p_holm: p after Holm over the types. mde:
    minimum detectable effect; None where the difference is significant, or where no difference could be.
    """

    a: float | None = None
    b: float | None = None
    value: float | None = None
    low: float | None = None
    high: float | None = None
    n: int = 0
    clusters: int = 0
    parts: int = 0
    won: int | None = None
    lost: int | None = None
    p: float | None = None
    p_holm: float | None = None
    mde: float | None = None
    method: str = "none"
    reason: str = "no pair"

    @property
    def significant(self) -> bool:
        """By McNemar (after Holm where that was applied); by the interval where the metric is not yes/no."""
        p = self.p if self.p_holm is None else self.p_holm
        if p is not None:
            return p < ALPHA
        return self.low is not None and self.high is not None and (self.low > 0.0 or self.high < 0.0)


@dataclass(frozen=True)
class Pairs:
    """n pairs that count. a, b: values; cluster: place of each; part: type of each, `parts` = number of types."""

    a: Array
    b: Array
    cluster: npt.NDArray[np.intp]
    part: npt.NDArray[np.intp]
    parts: int


def difference(
    bootstrap: ClusterBootstrap, label: str, pairs: Pairs, metric: Metric, macro: bool = False
) -> Difference:
    """B - A with all that belongs to it; macro: mean over types, else over pairs. The draws are those of `label`."""
    n, scale = len(pairs.a), metric.scale
    if not n:
        return Difference()
    delta = pairs.b - pairs.a
    count = sums_by_cluster(delta, pairs.cluster, pairs.part, pairs.parts)[1]
    filled = count.sum(axis=0) > 0
    count = count[:, filled]
    weights = part_weights(count, macro)

    def sums(values: Array) -> Array:
        return sums_by_cluster(values, pairs.cluster, pairs.part, pairs.parts)[0][:, filled]

    def mean(values: Array) -> float:
        return round(scale * float(weights @ (sums(values).sum(axis=0) / count.sum(axis=0))), _DIGITS)

    won, lost = int(np.count_nonzero(delta > 0)), int(np.count_nonzero(delta < 0))
    error = None
    if len(count) < MIN_CLUSTERS:
        low, high, method, reason = None, None, "none", f"only {len(count)} places, fewer than {MIN_CLUSTERS}"
    elif metric.binary:
        low, high = _flips_interval(sums(np.maximum(delta, 0.0)), sums(np.maximum(-delta, 0.0)), count, macro)
        method, reason = "effective sample size", ""
    else:
        pooled = (part if macro else part.sum(axis=1, keepdims=True) for part in (sums(delta), count))
        draws = bootstrap.draws(label, *pooled)
        low, high = percentiles(draws)
        method, reason, error = "cluster bootstrap", "", float(draws.std(ddof=1))
        if high - low <= _ALIKE:
            low, high, method, reason, error = None, None, "none", "all places alike", None
    low, high = (None if end is None else round(scale * end, _DIGITS) for end in (low, high))
    a, b, value, parts = mean(pairs.a), mean(pairs.b), mean(delta), count.shape[1] if macro else 1
    rests = {"n": n, "clusters": count.shape[0], "parts": parts}
    found = Difference(a=a, b=b, value=value, low=low, high=high, **rests, method=method, reason=reason)
    if metric.binary:
        found = replace(found, won=won, lost=lost, p=mcnemar_p(won, lost))
        return found if found.significant else replace(found, mde=_scaled(scale, found, ALPHA))
    if found.significant or error is None:
        return found
    # So many standard errors a difference must have to be found with POWER (two-sided, normal).
    multiple = NormalDist().inv_cdf(1 - ALPHA / 2) + NormalDist().inv_cdf(POWER)
    return replace(found, mde=round(scale * multiple * error, _DIGITS))


def adjust(types: Mapping[str, Difference], scale: float) -> dict[str, Difference]:
    """McNemar's p of each type after Holm over all of them, and what each type could then still have shown.

    The effect is that which Holm finds whatever the other types show: its strictest step, ALPHA / number of types.
    """
    tested = [kind for kind, d in types.items() if d.p is not None]
    adjusted = dict(zip(tested, holm([types[kind].p or 0.0 for kind in tested]), strict=True))
    result = {}
    for kind, d in types.items():
        d = replace(d, p_holm=adjusted.get(kind), mde=None)
        wanted = d.p is not None and not d.significant
        result[kind] = replace(d, mde=_scaled(scale, d, ALPHA / len(tested))) if wanted else d
    return result


def mcnemar_p(won: int, lost: int) -> float:
    """Two-sided exact (binomial) McNemar test of the pairs that differ, from statsmodels."""
    return _mcnemar_p(max(won, lost), min(won, lost))


@lru_cache(maxsize=_KEPT)
def _mcnemar_p(won: int, lost: int) -> float:
    from statsmodels.stats.contingency_tables import mcnemar  # brings pandas: late

    return float(mcnemar([[0, won], [lost, 0]], exact=True).pvalue)


def holm(p: list[float]) -> list[float]:
    """Holm's adjusted values. statsmodels' own function collects garbage at each call: 0.4 s in a large report."""
    order = np.argsort(p)
    adjusted = np.empty(len(p))
    adjusted[order] = np.minimum(np.maximum.accumulate(np.array(p)[order] * np.arange(len(p), 0, -1)), 1.0)
    return [float(x) for x in adjusted]


def detectable(n: int, won: int, lost: int, alpha: float) -> float | None:
    """Least difference (0-1) that exact McNemar on n pairs finds at `alpha` with POWER; None if it finds none.

    The rarer of the two kinds of flips keeps the rate that was observed (as far as there is room for it beside the
    effect); the other makes the difference.
    """
    return _detectable(n, min(won, lost), alpha)


@lru_cache(maxsize=_KEPT)
def _detectable(n: int, rarer: int, alpha: float) -> float | None:
    from scipy.optimize import brentq

    rare = rarer / n

    def beyond(effect: float) -> float:
        return mcnemar_power(n, min(rare, (1.0 - effect) / 2), effect, alpha) - POWER

    return None if beyond(1.0) < 0.0 else float(brentq(beyond, 0.0, 1.0, xtol=1e-6))


def mcnemar_power(n: int, rare: float, effect: float, alpha: float) -> float:
    """How often exact McNemar finds, on the right side, flips of rates `rare` and `rare + effect` in n pairs."""
    from scipy.stats import binom

    both = min(2.0 * rare + effect, 1.0)
    if both <= 0.0:
        return 0.0
    # So many flips as there can well be: beyond, all together are less likely than 1e-20 (Bernstein's inequality).
    mean, spread = n * both, 10.0 * np.sqrt(n * both * (1.0 - both)) + 40.0
    flips = np.arange(max(int(mean - spread), 0), min(int(mean + spread), n) + 1)
    # No row of the table knows n: one of rounded length serves many.
    edge = _edges(1 << n.bit_length(), alpha)[flips]
    found = binom.cdf(edge, flips, rare / both)
    return float(binom.pmf(flips, n, both) @ np.where(edge < 0, 0.0, found))


@lru_cache(maxsize=64)
def _edges(n: int, alpha: float) -> Array:
    """(n + 1,) the test rejects 0, 1, … n flips where at most so many go the other way; -1: never."""
    from scipy.stats import binom

    flips = np.arange(n + 1)
    edge = binom.ppf(alpha / 2, flips, 0.5)
    edges: Array = np.where(binom.cdf(edge, flips, 0.5) > alpha / 2, edge - 1, edge)
    edges.flags.writeable = False
    return edges


def _scaled(scale: float, d: Difference, alpha: float) -> float | None:
    effect = detectable(d.n, d.won or 0, d.lost or 0, alpha)
    return None if effect is None else round(scale * effect, 6)


def _flips_interval(won: Array, lost: Array, count: Array, macro: bool) -> tuple[float, float]:
    """Ends of the interval of won - lost, means over parts of shares. won, lost, count: (clusters, parts)."""
    n, weights = count.sum(axis=0), part_weights(count, macro)
    gain, loss = (float(weights @ (flips.sum(axis=0) / n)) for flips in (won, lost))
    (gain_low, gain_high), (loss_low, loss_high) = (share_interval(flips, count, macro) for flips in (won, lost))
    # A pair is not both: where more are won, fewer can be lost.
    room = (1.0 - gain) * (1.0 - loss)
    opposed = 2.0 * np.sqrt(gain * loss / room) if room > 0.0 else 0.0

    def reach(up: float, down: float) -> float:
        return float(np.sqrt(up**2 + down**2 + opposed * up * down))

    return (
        max(gain - loss - reach(gain - gain_low, loss_high - loss), -1.0),
        min(gain - loss + reach(gain_high - gain, loss - loss_low), 1.0),
    )


_SAME = ("scenario_id", "scenario_type", "group", "map_id", "pair_id", "half")
_SHOWN = {"outcome": "outcome", "clause": "violation_clause", "error": "error"}


@dataclass(frozen=True, slots=True)
class Flip:
    """A scenario that one of the two has as SCD and the other has not. won: it is B that has it.

    clause_*: first clause of the target rule that was broken; error_*: cause of an error outcome; None if none.
    """

    scenario_id: str
    scenario_type: str
    group: str
    map_id: str
    pair_id: str
    half: str
    won: bool
    outcome_a: str
    clause_a: str | None
    error_a: str | None
    outcome_b: str
    clause_b: str | None
    error_b: str | None


@dataclass(frozen=True)
class Comparison:
    """B against A, the figures as in `Breakdown`, types after Holm. flips: lost ones first, then by type.

    scenarios: that both drove; completed: those without an error outcome on either side.
    """

    scores: Mapping[str, Scores[Difference]]
    metrics: Mapping[str, StrictAndCompleted[Difference]]
    flips: tuple[Flip, ...]
    scenarios: int
    completed: int

    @property
    def primary(self) -> Scores[Difference]:
        """Paired SCD; of records without pairs the first figure of SCD that they have."""
        return next(iter(self.scores.values()))


def shared_scenarios(a: pa.Table, b: pa.Table) -> tuple[pa.Table, pa.Table]:
    """The records of scenarios that both have."""
    of_a, of_b = (table["scenario_id"].to_pylist() for table in (a, b))
    return with_text(a, "scenario_id", *of_b), with_text(b, "scenario_id", *of_a)


def compare(a: pa.Table, b: pa.Table, seed: str) -> Comparison:
    """Compare two planners' episode records of the same scenarios. seed: of the bootstrap, the contract hash.

    Raises InputError where records are malformed, or are not of the same scenarios.
    """
    a, b = (table.sort_by("scenario_id") for table in (a, b))
    for column in _SAME:
        for scenario, x, y in zip(
            a["scenario_id"].to_pylist(), a[column].to_pylist(), b[column].to_pylist(), strict=True
        ):
            if x != y:
                raise InputError(f"scenario {scenario}: {column} is {x!r} in A and {y!r} in B: not comparable")
    (left,), (right,) = (split_records(table).values() for table in (a, b))
    bootstrap = ClusterBootstrap(seed)

    def measure(
        metric: Metric, label: str, records: Records, values: Sequence[Array], use: Mask, macro: bool
    ) -> Difference:
        x, y = (v[use] for v in values)
        pairs = Pairs(x, y, records.place[use], records.kind[use], len(records.kinds))
        return difference(bootstrap, label, pairs, metric, macro)

    found = break_down([left, right], measure)
    scores = {part: _adjusted(figures) for part, figures in found.scores.items()}
    whole = int(np.count_nonzero(~left.error & ~right.error))
    return Comparison(scores, found.metrics, _flips(a, b), len(left), whole)


def _adjusted(figures: Scores[Difference]) -> Scores[Difference]:
    """Holm over the strict figures of the types, and over the completed ones."""
    strict = adjust({kind: figure.main for kind, figure in figures.types.items()}, SCD.scale)
    completed = adjust({kind: figure.completed for kind, figure in figures.types.items()}, SCD.scale)
    return replace(figures, types={kind: StrictAndCompleted(strict[kind], completed[kind]) for kind in figures.types})


def _flips(a: pa.Table, b: pa.Table) -> tuple[Flip, ...]:
    columns = [*_SAME, "scd", *_SHOWN.values()]
    found = []
    for x, y in zip(a.select(columns).to_pylist(), b.select(columns).to_pylist(), strict=True):
        if bool(x["scd"]) != bool(y["scd"]):
            what = {name: x[name] for name in _SAME} | {"won": bool(y["scd"])}
            what |= {f"{name}_{side}": row[c] for side, row in (("a", x), ("b", y)) for name, c in _SHOWN.items()}
            found.append(Flip(**what))
    return tuple(sorted(found, key=lambda f: (f.won, f.scenario_type, f.scenario_id)))
