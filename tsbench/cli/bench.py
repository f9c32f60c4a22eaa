"""`tsbench bench`: how fast the harness is here."""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table


@click.command()
@click.option("--scenes", type=click.IntRange(1), default=12, show_default=True, help="How many scenes.")
@click.option(
    "--rounds", type=click.IntRange(1), default=5, show_default=True, help="Medians over so many rounds."
)
@click.option(
    "--json", "json_path", type=click.Path(path_type=Path), default=None, help="Write the figures here."
)
@click.option(
    "--networks", is_flag=True, help="What learned planners' networks take for an answer, and nothing else."
)
def bench(scenes: int, rounds: int, json_path: Path | None, networks: bool) -> None:
    """Measure bare SUMO, ego and snapshot, and the whole tick, on the same scenes in one run."""
    if networks:
        _networks(json_path)
        return
    from tsbench.tools.bench import run_bench

    console = Console()
    with console.status("choosing scenes") as status:
        result = run_bench(scenes, rounds, lambda text: status.update(text))
    table = Table(
        "loop", "ticks/s per core", "share of a tick", title=f"{result.vehicles:.1f} vehicles on average"
    )
    full = result.full_ticks_per_s
    table.add_row(
        "bare libsumo step", f"{result.bare_ticks_per_s:,.0f}", f"{full / result.bare_ticks_per_s:.0%}"
    )
    table.add_row(
        "ego placed, surroundings read",
        f"{result.ego_ticks_per_s:,.0f}",
        f"{full / result.ego_ticks_per_s:.0%}",
    )
    table.add_row("whole tick: idm, monitors, recording", f"{full:,.0f}", "100%")
    console.print(table)
    console.print(f"whole tick by ego tick: {result.ego_ticks_per_s / full:.2f}x (goal: at most 3)")
    console.print(f"a new episode in a warm worker starts within {result.episode_start_ms:.0f} ms (goal: 50)")
    console.print(f"two workers by one: {result.workers_speedup:.2f}x (goal: 1.9)")
    if json_path is not None:
        json_path.write_text(json.dumps(result.to_dict(), indent=1) + "\n", encoding="utf-8")


def _networks(json_path: Path | None) -> None:
    from tsbench.tools.bench_networks import bench_networks

    console, table = (
        Console(),
        Table("network", "ms alone", "ms each of eight", title="CPU time of an answer"),
    )
    figures = {}
    for name, alone, together in bench_networks():
        table.add_row(name, f"{alone:.2f}", f"{together:.2f}")
        figures[name] = {"alone_ms": round(alone, 4), "of_eight_ms": round(together, 4)}
    console.print(table)
    if json_path is not None:
        json_path.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
