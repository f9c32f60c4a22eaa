"""`tsbench bench`: how fast the harness is here."""

from __future__ import annotations

from pathlib import Path

import click
from rich.console import Console

from tsbench.cli.console import print_table
from tsbench.cli.options import FILE, POSITIVE
from tsbench.core.files import write_json


@click.command()
@click.option("--limit", type=POSITIVE, metavar="N", default=12, show_default=True, help="How many scenes.")
@click.option("--rounds", type=POSITIVE, default=5, show_default=True, help="Medians over so many rounds.")
@click.option("--json", "json_path", type=FILE, metavar="FILE", help="Write the figures here.")
@click.option(
    "--networks", is_flag=True, help="What learned planners' networks take for an answer, and nothing else."
)
@click.option("--env", "env", is_flag=True, help="Steps of the Gymnasium environment, and nothing else.")
@click.option(
    "--isolation", is_flag=True, help="What a planner's own process costs a tick, and nothing else."
)
def bench(
    limit: int, rounds: int, json_path: Path | None, networks: bool, env: bool, isolation: bool
) -> None:
    """Measure bare SUMO, ego and snapshot, and the whole tick, on the same scenes in one run."""
    if isolation:
        _isolation(limit, rounds, json_path)
        return
    if env:
        _environment(rounds, json_path)
        return
    if networks:
        _networks(json_path)
        return
    from tsbench.tools.bench import run_bench

    console = Console()
    with console.status("choosing scenes") as status:
        result = run_bench(limit, rounds, lambda text: status.update(text))
    full = result.full_ticks_per_s
    loops = {
        "bare libsumo step": result.bare_ticks_per_s,
        "ego placed, surroundings read": result.ego_ticks_per_s,
        "whole tick: idm, monitors, recording": full,
    }
    rows = [(name, f"{speed:,.0f}", f"{full / speed:.0%}") for name, speed in loops.items()]
    title = f"{result.vehicles:.1f} vehicles on average"
    print_table(("loop", "ticks/s per core", "share of a tick"), rows, title=title)
    console.print(f"whole tick by ego tick: {result.ego_ticks_per_s / full:.2f}x (goal: at most 3)")
    console.print(f"a new episode in a warm worker starts within {result.episode_start_ms:.0f} ms (goal: 50)")
    console.print(f"two workers by one: {result.workers_speedup:.2f}x (goal: 1.9)")
    if json_path is not None:
        write_json(json_path, result.to_dict())


def _isolation(limit: int, rounds: int, json_path: Path | None) -> None:
    from tsbench.tools.bench_isolation import bench_isolation

    found = bench_isolation(limit, rounds)
    rows = [(name, f"{here:.0f}", f"{apart:.0f}", f"{apart - here:.0f}") for name, here, apart in found]
    print_table(
        ("planner", "µs together", "µs isolated", "difference"), rows, title="median time of an answer"
    )
    if json_path is not None:
        write_json(json_path, {name: {"together_us": a, "isolated_us": b} for name, a, b in found})


def _networks(json_path: Path | None) -> None:
    from tsbench.tools.bench_networks import bench_networks

    found = list(bench_networks())
    rows = [(name, f"{alone:.2f}", f"{together:.2f}") for name, alone, together in found]
    print_table(("network", "ms alone", "ms each of eight"), rows, title="CPU time of an answer")
    figures = {name: {"alone_ms": round(a, 4), "of_eight_ms": round(b, 4)} for name, a, b in found}
    if json_path is not None:
        write_json(json_path, figures)


def _environment(rounds: int, json_path: Path | None) -> None:
    from tsbench.envs.speed import BLOCK, rates_of

    goals = {"vector": 1500, "scene": 800}
    figures = {kind: rates_of(kind, rounds * BLOCK) for kind in goals}
    rows = [
        (kind, f"{alone:,.0f}", f"{whole:,.0f}", f"{goals[kind]:,}")
        for kind, (alone, whole) in figures.items()
    ]
    print_table(("observation", "steps/s per core", "with episode starts", "goal"), rows, title="environment")
    if json_path is not None:
        write_json(
            json_path, {kind: {"steps_per_s": a, "with_starts": b} for kind, (a, b) in figures.items()}
        )
