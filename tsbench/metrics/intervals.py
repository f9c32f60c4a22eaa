"""95 % intervals: cluster bootstrap over places, Wilson where nothing clusters. Source: docs/spec/metrics.md.

Variants on one map are alike, and so are maps of one place, so places are drawn, not episodes. All planners of a
summary see the same draws.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from math import sqrt
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


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Wilson's score interval of a share. Source: Wilson 1927, JASA 22, 209-212; the ends of 0 and n are exact.

    SciPy has it too, in a module that takes longer to import than a whole run's tables to compute.
    """
    share, spread = successes / n, _Z**2 / n
    centre = (share + spread / 2) / (1 + spread)
    half = _Z / (1 + spread) * sqrt(share * (1 - share) / n + spread / (4 * n))
    return 0.0 if successes == 0 else centre - half, 1.0 if successes == n else centre + half


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

    def estimate(self, label: str, total: Array, count: Array, scale: float, binary: bool) -> Estimate:
        """Macro mean over parts of the mean within each part.

        total, count: (clusters, parts) sum of values and number of episodes of each cluster in each part; a
        part without an episode is left out, in the value and in each draw. binary: values are 0 or 1.
        """
        held = count.sum(axis=1) > 0
        total, count = total[held][:, count.sum(axis=0) > 0], count[held][:, count.sum(axis=0) > 0]
        clusters, parts = count.shape
        n = int(count.sum())
        if not n:
            return Estimate(None, None, None, 0, 0, 0, "none", "no episode")
        value = float((total.sum(axis=0) / count.sum(axis=0)).mean())
        low, high, method, reason = self._interval(label, total, count, value, binary)
        ends = [None if end is None else round(scale * end, _DIGITS) for end in (low, high)]
        return Estimate(round(scale * value, _DIGITS), ends[0], ends[1], n, clusters, parts, method, reason)

    def _interval(
        self, label: str, total: Array, count: Array, value: float, binary: bool
    ) -> tuple[float | None, float | None, str, str]:
        clusters, parts = count.shape
        if clusters < MIN_CLUSTERS:
            return None, None, "none", f"only {clusters} places, fewer than {MIN_CLUSTERS}"
        alone = parts == 1 and bool((count == 1).all())
        if binary and alone:
            return *wilson(round(float(total.sum())), clusters), "wilson", "one episode at each place"
        rates = total.sum(axis=1) / count.sum(axis=1)
        if np.ptp(rates) < _ALIKE:
            if binary:
                # All draws would be equal: an interval of no width would claim certainty.
                return *wilson(round(value * clusters), clusters), "wilson", "all places alike: over places"
            return None, None, "none", "all places alike"
        low, high = percentiles(self.draws(label, total, count))
        if high - low >= _ALIKE:
            return low, high, "cluster bootstrap", ""
        # Every type is wholly passed or wholly failed, so the macro mean of nearly all draws is the same.
        if binary:
            return *wilson(round(value * clusters), clusters), "wilson", "places of a type alike: over places"
        return None, None, "none", "places of a type alike"

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
