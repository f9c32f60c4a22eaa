"""Coverage of the 95 % intervals of shares, in a simulation: prints the figures behind docs/metrics.md.

Passes are drawn from beta-binomials. A place holds 1 to 4 pairs of a type, as in the test split, or ten; in the means
over types, places and types are those of the pairs in results/plant2-ft. A cell is the least and the greatest coverage
over RATES. Below it stands the intra-place correlation of the kept results.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import click
import numpy as np
import pyarrow.parquet as pq

from tsbench.core.paths import data_root
from tsbench.geometry.polyline import Array
from tsbench.metrics.episode_metrics import SCD
from tsbench.metrics.intervals import share_interval, sums_by_cluster
from tsbench.metrics.scd_records import PAIRED, split_records

RATES = (0.002, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 0.998)
CORRELATIONS = (0.0, 0.1, 0.25, 0.5)
PLACES = (5, 10, 20, 40, 90)
SEED = 2026
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


def coverage(count: Array, rate: float, correlation: float, draws: int, rng: np.random.Generator) -> float:
    """Share of intervals that hold `rate`.

    count: (places, types) pairs; a place's own rate differs from type to type.
    """
    inside = 0
    for _ in range(draws):
        at = np.full(count.shape, rate)
        if correlation:
            odds = 1.0 / correlation - 1.0
            at = rng.beta(rate * odds, (1.0 - rate) * odds, size=count.shape)
        low, high = share_interval(rng.binomial(count.astype(np.int64), at).astype(np.float64), count)
        inside += low <= rate <= high
    return inside / draws


@click.command()
@click.option("--draws", default=500, show_default=True, help="Simulated tables of each rate.")
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
    for name, count in designs.items():
        cells = []
        for correlation in CORRELATIONS:
            found = [100.0 * coverage(count, rate, correlation, draws, rng) for rate in RATES]
            cells.append(f"{min(found):.1f} to {max(found):.1f}")
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)
    of_one, of_two = correlations(RUNS)
    print(
        f"intra-place correlation of {', '.join(RUNS)}: {of_one:.3f} within types, {of_two:.3f} between types"
    )


if __name__ == "__main__":
    main()
