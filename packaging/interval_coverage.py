"""Coverage of the 95 % intervals of shares, in a simulation: prints the figures behind docs/metrics.md.

Passes are drawn from beta-binomials. A place holds 1 to 4 pairs of a type, as in the test split, or ten; in the means
over types, places and types are those of the pairs in results/plant2-ft. A cell is the least and the greatest coverage
over RATES. Below stand how many of all coverages are in BAND, how many can be, and the intra-place correlation of the
kept results.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import click
import numpy as np
import pyarrow.parquet as pq

from tsbench.core.paths import data_root
from tsbench.geometry.polyline import Array
from tsbench.metrics.intervals import share_interval, sums_by_cluster
from tsbench.metrics.records import split_records
from tsbench.metrics.scd import PAIRED, SCD

RATES = (0.002, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 0.998)
CORRELATIONS = (0.0, 0.1, 0.25, 0.5)
PLACES = (5, 10, 20, 40, 90)
SEED = 2026
BAND = (0.93, 0.98)
RUNS = ("styles", "networks", "plant2-ft", "floors", "bare", "mirrored-moscow", "ft-poor", "readers-poor")


def tables(run: str) -> Iterator[tuple[Array, Array]]:
    """(places, types) pairs that each planner of a kept run passed, and pairs, one of each map."""
    for records in split_records(pq.read_table(data_root() / "results" / run / "episodes.parquet")).values():
        pairs = records.of(PAIRED)
        passed = np.where(pairs.error, 0.0, pairs.values[SCD.column])
        yield sums_by_cluster(passed, pairs.place, pairs.kind, len(pairs.kinds))


def correlations(runs: Sequence[str]) -> tuple[float, float]:
    """Correlation of two pairs of a place, of one type and of two: of the residuals from each type's share, pooled."""
    within, across = np.zeros(2), np.zeros(2)
    for total, count in (table for run in runs for table in tables(run)):
        n = count.sum(axis=0)
        share = total.sum(axis=0) / n
        spread, residual = share * (1.0 - share), total - share * count
        own = total * (1.0 - share) ** 2 + (count - total) * share**2
        couples = spread * count * (count - 1.0)
        within += (residual**2 - own).sum() + (couples / n).sum(), couples.sum()
        weight = count @ np.sqrt(spread)
        across += (
            (residual.sum(axis=1) ** 2).sum() - (residual**2).sum(),
            (weight**2).sum() - (count**2 * spread).sum(),
        )
    return float(within[0] / within[1]), float(across[0] / across[1])


def coverage(count: Array, rate: float, correlation: float, draws: int, rng: np.random.Generator) -> tuple[float, bool]:
    """Share of intervals that hold `rate`, and whether it can be in BAND.

    count: (places, types) pairs; a place's own rate differs from type to type. An interval whose ends rise with the
    mean holds `rate` for neighbouring means: where no run of them has a probability in BAND, it cannot be in BAND.
    """
    inside, means = 0, np.empty(draws)
    for i in range(draws):
        at = np.full(count.shape, rate)
        if correlation:
            odds = 1.0 / correlation - 1.0
            at = rng.beta(rate * odds, (1.0 - rate) * odds, size=count.shape)
        total = rng.binomial(count.astype(np.int64), at).astype(np.float64)
        low, high = share_interval(total, count)
        inside += low <= rate <= high
        means[i] = (total.sum(axis=0) / count.sum(axis=0)).mean()
    below = np.concatenate(([0.0], np.unique(means.round(9), return_counts=True)[1].cumsum() / draws))
    runs = below[None, :] - below[:, None]
    return inside / draws, bool(((runs >= BAND[0]) & (runs <= BAND[1])).any())


@click.command()
@click.option("--draws", default=1000, show_default=True, help="Simulated tables of each rate.")
def main(draws: int) -> None:
    """Print the figures behind docs/metrics.md, and the correlation."""
    rng = np.random.default_rng(np.random.SeedSequence(SEED))
    designs = {}
    for places in PLACES:
        sizes = np.minimum(rng.geometric(0.6, size=(places, 1)), 4).astype(np.float64)
        designs[f"one type, {places} places, {int(sizes.sum())} pairs"] = sizes
    designs["one type, 15 places, ten pairs at each"] = np.full((15, 1), 10.0)
    ((_, every),) = tables("plant2-ft")
    five = every[:, :5]
    designs["mean of 5 types of test"] = five[five.sum(axis=1) > 0.0]
    designs[f"mean of {every.shape[1]} types of test"] = every
    print("| | " + " | ".join(f"correlation {value:g}" for value in CORRELATIONS) + " |")
    print("|---|" + "---|" * len(CORRELATIONS))
    every_one = []
    for name, count in designs.items():
        cells = []
        for correlation in CORRELATIONS:
            found = [coverage(count, rate, correlation, draws, rng) for rate in RATES]
            shares = [100.0 * share for share, _ in found]
            cells.append(f"{min(shares):.1f} to {max(shares):.1f}")
            every_one += found
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
    (least, most), held = BAND, [share for share, _ in every_one]
    below, above = sum(share < least for share in held), sum(share > most for share in held)
    never = sum(not can for _, can in every_one)
    print(f"of {len(held)}: {below} below {least:.0%}, {above} above {most:.0%}; no interval has {never} in between")
    of_one, of_two = correlations(RUNS)
    print(f"intra-place correlation of {', '.join(RUNS)}: {of_one:.3f} within types, {of_two:.3f} between types")


if __name__ == "__main__":
    main()
