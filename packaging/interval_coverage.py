"""Coverage of the 95 % intervals of shares, in a simulation: prints the table of docs/spec/metrics.md.

Passes are drawn from beta-binomials. A place holds 1 to 4 pairs of a type, as in the test split, or ten; in the means
over types, places and types are those of the pairs in results/plant2-ft. A cell is the least and the greatest coverage
over RATES.
"""

from __future__ import annotations

import click
import numpy as np
import pyarrow.parquet as pq

from tsbench.core.paths import data_root
from tsbench.geometry.polyline import Array
from tsbench.metrics.intervals import share_interval, sums_by_cluster
from tsbench.metrics.records import PAIRED, split_records

RATES = (0.002, 0.01, 0.05, 0.2, 0.5, 0.8, 0.95, 0.99, 0.998)
CORRELATIONS = (0.0, 0.1, 0.25, 0.5)
PLACES = (5, 10, 20, 40, 90)
SEED = 2026


def test_split() -> Array:
    """(places, types) pairs of the test split, one of each map."""
    records = split_records(pq.read_table(data_root() / "results" / "plant2-ft" / "episodes.parquet"))
    pairs = records["plant2-ft"].of(PAIRED)
    return sums_by_cluster(np.zeros(len(pairs)), pairs.place, pairs.kind, len(pairs.kinds))[1]


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
@click.option("--draws", default=2000, show_default=True, help="Simulated tables of each rate.")
def main(draws: int) -> None:
    """Print the table of docs/spec/metrics.md."""
    rng = np.random.default_rng(np.random.SeedSequence(SEED))
    designs = {}
    for places in PLACES:
        sizes = np.minimum(rng.geometric(0.6, size=(places, 1)), 4).astype(np.float64)
        designs[f"one type, {places} places, {int(sizes.sum())} pairs"] = sizes
    designs["one type, 15 places, ten pairs at each"] = np.full((15, 1), 10.0)
    every = test_split()
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


if __name__ == "__main__":
    main()
