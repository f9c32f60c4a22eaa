"""95 % intervals of figures over clusters. Source: docs/metrics.md.

Variants on one map are alike, and so are maps of one place: a place is a cluster. A share (of pairs passed, of types'
macro mean) has the interval of a binomial share of its effective sample size; other means have a cluster bootstrap,
in which all planners of a summary see the same draws.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from tsbench.geometry.polyline import Array

LEVEL = 0.95
RESAMPLES = 10_000
MIN_CLUSTERS = 5
_DIGITS = 9
_ALIKE = 1e-12
_Z = NormalDist().inv_cdf((1 + LEVEL) / 2)

# Chosen by the coverage that docs/metrics.md shows: the intra-place correlation before any place is seen, for how many
# cells (a place in a part) it counts, the degrees of freedom beside those of the places, and by how many episodes at
# the whole mean the share of a type is smoothed.
_PRIOR_CORRELATION = 0.35
_PRIOR_CELLS = 25.0
_PRIOR_FREEDOM = 10.0
_PRIOR_EPISODES = 20.0

_Codes = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Estimate:
    """A mean with its interval and what it rests on.

    value: None where no episode counts. low, high: None where there is no interval; `reason` says why. n:
    episodes that count; clusters: places that they are at; parts: types that a macro mean is over (1
    otherwise).
    """

    value: float | None
    low: float | None
    high: float | None
    n: int
    clusters: int
    parts: int
    method: str
    reason: str


def share_ends(share: Array, n: Array) -> tuple[Array, Array]:
    """Ends of the interval of a binomial share: Jeffreys's (Brown, Cai and DasGupta 2001, Statistical Science 16).

    share: (k,) 0-1; n: (k,) sample sizes, not necessarily whole. The ends of 0 and 1 are exact.
    """
    from scipy.special import betaincinv

    passed, tail = share * n + 0.5, (1 - LEVEL) / 2
    failed = n + 1.0 - passed
    return (
        np.where(share <= 0.0, 0.0, betaincinv(passed, failed, tail)),
        np.where(share >= 1.0, 1.0, betaincinv(passed, failed, 1.0 - tail)),
    )


def share_interval(total: Array, count: Array, macro: bool = True) -> tuple[float, float]:
    """Ends of the interval of a mean over parts of the share of passes within each part.

    total, count: (clusters, parts) passes and episodes, no row or column of `count` empty. macro: parts weigh alike,
    else by their episodes, so that the mean is the share of all. The mean is read as a
    binomial share of its effective sample size (Korn and Graubard 1998, Survey Methodology 24, 193-201; Dean and
    Pagano 2015, Journal of Survey Statistics and Methodology 3, 484-503). Its ends are nowhere nearer than the ends of
    any part alone allow.
    """
    weights = part_weights(count, macro)
    value, size = _effective(total, count, weights)
    alone = []
    if len(weights) > 1:
        held = (np.flatnonzero(column) for column in count.T)
        alone = [_effective(total[rows][:, [k]], count[rows][:, [k]], np.ones(1)) for k, rows in enumerate(held)]
    shares, sizes = (np.array(column) for column in zip((value, size), *alone, strict=True))
    low, high = share_ends(shares, sizes)
    weighed = np.concatenate(([1.0], weights[: len(alone)]))
    below, above = weighed * (shares - low), weighed * (high - shares)
    return (
        min(float(low[0]), value - float(below[1:].max(initial=0.0))),
        max(float(high[0]), value + float(above[1:].max(initial=0.0))),
    )


def part_weights(count: Array, macro: bool) -> Array:
    """(parts,) what each part counts for in a mean. count: (clusters, parts) episodes."""
    n = count.sum(axis=0)
    return np.full(len(n), 1.0 / len(n)) if macro else n / n.sum()


def _effective(total: Array, count: Array, weights: Array) -> tuple[float, float]:
    """A weighted mean of shares, and its effective sample size: as many independent episodes would tell as much."""
    n = count.sum(axis=0)
    shares = total.sum(axis=0) / n
    # At most 1, which the sum of weights may miss by a rounding.
    value = min(float(weights @ shares), 1.0) if (shares < 1.0).any() else 1.0
    # A part with all or no passes may vary all the same; where all parts are like that, they count alike.
    smoothed = (total.sum(axis=0) + _PRIOR_EPISODES * value) / (n + _PRIOR_EPISODES)
    known = 0.0 < value < 1.0
    spread = smoothed * (1.0 - smoothed) if known else np.ones(len(n))
    alike = 1.0 + _intraplace_correlation(total, count, shares) * ((count**2).sum(axis=0) / n - 1.0)
    size = (value * (1.0 - value) if known else 1.0) / float((weights**2 * spread * alike / n).sum())
    places = 1.0 / float((((count / n) @ weights) ** 2).sum())
    return value, size * (_Z / _student(places - 1.0 + _PRIOR_FREEDOM)) ** 2


def _student(freedom: float) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(freedom, (1 + LEVEL) / 2))


def _intraplace_correlation(total: Array, count: Array, shares: Array) -> float:
    """Correlation of two episodes of one part at one place, 0-1: of the residuals from each part's share.

    Drawn to the prior, against which it counts as much as there are cells (a place in a part) of several episodes with
    a pass, or with a failure, whichever are fewer.
    """
    n, spread = count.sum(axis=0), shares * (1.0 - shares)
    several = (count >= 2.0) & (spread > 0.0)
    told = float(min((several & (total > 0.0)).sum(), (several & (total < count)).sum()))
    if not told:
        return _PRIOR_CORRELATION
    residual = total - shares * count
    own = total * (1.0 - shares) ** 2 + (count - total) * shares**2
    pairs = spread * count * (count - 1.0)
    found = ((residual**2 - own).sum() + (pairs / n).sum()) / pairs.sum()
    return (_PRIOR_CELLS * _PRIOR_CORRELATION + told * float(np.clip(found, 0.0, 1.0))) / (_PRIOR_CELLS + told)


class ClusterBootstrap:
    """Draws of clusters with replacement. Equal seeds and labels give equal draws, whatever else is asked."""

    def __init__(self, seed: str, resamples: int = RESAMPLES) -> None:
        self._seed = seed
        self.resamples = resamples
        self._drawn: dict[tuple[str, int], Array] = {}

    def weights(self, label: str, clusters: int) -> Array:
        """(resamples, clusters): how often each cluster is in each draw."""
        key = (label, clusters)
        if key not in self._drawn:
            digest = hashlib.sha256(f"{self._seed}\n{label}".encode()).digest()
            rng = np.random.default_rng(np.random.SeedSequence(int.from_bytes(digest)))
            drawn = rng.integers(0, clusters, size=(self.resamples, clusters), dtype=np.int32)
            drawn += np.arange(self.resamples, dtype=np.int32)[:, None] * np.int32(clusters)
            counts = np.bincount(drawn.ravel(), minlength=self.resamples * clusters)
            self._drawn[key] = counts.reshape(self.resamples, clusters).astype(np.float64)
        return self._drawn[key]

    def estimate(
        self, label: str, total: Array, count: Array, scale: float, binary: bool, macro: bool = True
    ) -> Estimate:
        """Mean over parts of the mean within each part.

        total, count: (clusters, parts) sum of values and number of episodes of each cluster in each part; a
        part without an episode is left out, in the value and in each draw. binary: values are 0 or 1. macro: parts
        weigh alike, else by their episodes.
        """
        held = count.sum(axis=1) > 0
        total, count = total[held][:, count.sum(axis=0) > 0], count[held][:, count.sum(axis=0) > 0]
        clusters, parts = count.shape
        n = int(count.sum())
        if not n:
            return Estimate(None, None, None, 0, 0, 0, "none", "no episode")
        value = float(part_weights(count, macro) @ (total.sum(axis=0) / count.sum(axis=0)))
        low, high, method, reason = self._interval(label, total, count, binary, macro)
        ends = [None if end is None else round(scale * end, _DIGITS) for end in (low, high)]
        parts = parts if macro else 1
        return Estimate(round(scale * value, _DIGITS), ends[0], ends[1], n, clusters, parts, method, reason)

    def _interval(
        self, label: str, total: Array, count: Array, binary: bool, macro: bool
    ) -> tuple[float | None, float | None, str, str]:
        if len(count) < MIN_CLUSTERS:
            return None, None, "none", f"only {len(count)} places, fewer than {MIN_CLUSTERS}"
        if binary:
            return *share_interval(total, count, macro), "effective sample size", ""
        if not macro:
            total, count = (sums.sum(axis=1, keepdims=True) for sums in (total, count))
        low, high = percentiles(self.draws(label, total, count))
        if high - low < _ALIKE:
            return None, None, "none", "all places alike"
        return low, high, "cluster bootstrap", ""

    def draws(self, label: str, total: Array, count: Array) -> Array:
        """(resamples,) the macro mean in each draw. total, count: as for `estimate`, no row or column of them empty."""
        clusters, parts = count.shape
        sums = self.weights(label, clusters) @ np.hstack((total, count))
        with np.errstate(invalid="ignore"):
            means: Array = np.nanmean(sums[:, :parts] / sums[:, parts:], axis=1)
        return means


def percentiles(draws: Array) -> tuple[float, float]:
    low, high = np.quantile(draws, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def sums_by_cluster(values: Array, cluster: _Codes, part: _Codes | int, parts: int) -> tuple[Array, Array]:
    """(clusters, parts) sum of values and number of episodes. cluster, part: (n,) codes; parts: how many there are."""
    held, at = np.unique(cluster, return_inverse=True)
    cell = at * parts + part
    shape, size = (len(held), parts), len(held) * parts
    count = np.bincount(cell, minlength=size).reshape(shape).astype(np.float64)
    total = np.bincount(cell, weights=values, minlength=size).reshape(shape).astype(np.float64)
    return total, count
