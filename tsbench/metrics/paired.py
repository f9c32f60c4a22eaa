"""Differences between two planners on the same scenarios. Source: docs/spec/metrics.md, "Aggregation".

Yes/no outcomes: exact McNemar, and a 95 % interval from those of the shares of pairs that either side alone passed
(Newcombe 1998, Statistics in Medicine 17, 2635-2650). Others: a cluster bootstrap over places, drawn once for both.
What is not significant says how large a difference it would have shown (minimum detectable effect).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array
from tsbench.metrics.episode import Metric
from tsbench.metrics.intervals import (
    LEVEL,
    MIN_CLUSTERS,
    ClusterBootstrap,
    part_weights,
    percentiles,
    share_interval,
    sums_by_cluster,
)

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
        total = sums(delta)
        if not macro:
            total, count = (sums_.sum(axis=1, keepdims=True) for sums_ in (total, count))
        draws = bootstrap.draws(label, total, count)
        low, high = percentiles(draws)
        method, reason, error = "cluster bootstrap", "", float(draws.std(ddof=1))
        if high - low <= _ALIKE:
            low, high, method, reason, error = None, None, "none", "all places alike", None
    found = Difference(
        a=mean(pairs.a), b=mean(pairs.b), value=mean(delta),
        low=None if low is None else round(scale * low, _DIGITS),
        high=None if high is None else round(scale * high, _DIGITS),
        n=n, clusters=count.shape[0], parts=count.shape[1] if macro else 1, method=method, reason=reason,
    )  # fmt: skip
    if metric.binary:
        found = replace(found, won=won, lost=lost, p=mcnemar_p(won, lost))
        return found if found.significant else replace(found, mde=_scaled(scale, found, ALPHA))
    if found.significant or error is None:
        return found
    return replace(found, mde=round(scale * _noise_multiple() * error, _DIGITS))


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
    from statsmodels.stats.multitest import multipletests

    return [float(x) for x in multipletests(p, alpha=ALPHA, method="holm")[1]] if p else []


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


def _noise_multiple() -> float:
    """How many standard errors a difference must have to be found with POWER (two-sided, normal)."""
    from scipy.stats import norm

    return float(norm.ppf(1 - ALPHA / 2) + norm.ppf(POWER))


def _flips_interval(won: Array, lost: Array, count: Array, macro: bool) -> tuple[float, float]:
    """Ends of the interval of won - lost, means over parts of shares. won, lost, count: (clusters, parts)."""
    n, weights = count.sum(axis=0), part_weights(count, macro)
    gain, loss = (float(weights @ (flips.sum(axis=0) / n)) for flips in (won, lost))
    (gain_low, gain_high), (loss_low, loss_high) = (
        share_interval(flips, count, macro) for flips in (won, lost)
    )
    # A pair is not both: where more are won, fewer can be lost.
    room = (1.0 - gain) * (1.0 - loss)
    opposed = 2.0 * np.sqrt(gain * loss / room) if room > 0.0 else 0.0

    def reach(up: float, down: float) -> float:
        return float(np.sqrt(up**2 + down**2 + opposed * up * down))

    return (
        max(gain - loss - reach(gain - gain_low, loss_high - loss), -1.0),
        min(gain - loss + reach(gain_high - gain, loss - loss_low), 1.0),
    )
