"""`tsbench bench`: how fast the harness is here."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click
from rich.console import Console

from tsbench.cli import benches, options
from tsbench.cli.console import print_table
from tsbench.cli.options import FILE, POSITIVE, Words
from tsbench.core.errors import InputError
from tsbench.core.files import write_json


@click.command()
@click.option("--limit", type=POSITIVE, metavar="N", default=12, show_default=True, help="How many scenes.")
@click.option("--rounds", type=POSITIVE, default=5, show_default=True, help="Medians over so many rounds.")
@click.option("--json", "json_path", type=FILE, metavar="FILE", help="Write the figures here.")
@click.option("--networks", is_flag=True, help="What learned planners' networks take for an answer, and nothing else.")
@click.option("--env", "env", is_flag=True, help="Steps of the Gymnasium environment, and nothing else.")
@click.option("--isolation", is_flag=True, help="What a planner's own process costs a tick, and nothing else.")
@click.option("--fresh", is_flag=True, help="What it costs that an episode begins afresh, and nothing else.")
@options.planners("With --isolation: planner to measure (default: idm and idm-e)")
def bench(limit: int, rounds: int, json_path: Path | None, isolation: bool, planners: Words, **only: bool) -> None:
    """Measure bare SUMO, ego and snapshot, and the whole tick, on the same scenes in one run."""
    if planners and not isolation:
        raise InputError("--planner: only what an own process costs is measured planner by planner: add --isolation")
    if isolation:
        _isolation(planners, limit, rounds, json_path)
        return
    if only["fresh"]:
        _fresh(limit, rounds, json_path)
        return
    if only["env"]:
        _environment(rounds, json_path)
        return
    if only["networks"]:
        _networks(json_path)
        return
    console = Console()
    with console.status("choosing scenes") as status:
        result = benches.run_bench(limit, rounds, lambda text: status.update(text))
    ego, full = result["ego_ticks_per_s"], result["full_ticks_per_s"]
    loops = {
        "bare libsumo step": result["bare_ticks_per_s"],
        "ego placed, surroundings read": ego,
        "whole tick: idm, monitors, recording": full,
    }
    rows = [(name, f"{speed:,.0f}", f"{full / speed:.0%}") for name, speed in loops.items()]
    title = f"{result['vehicles']:.1f} vehicles on average"
    print_table(("loop", "ticks/s per core", "share of a tick"), rows, title=title)
    console.print(f"whole tick by ego tick: {ego / full:.2f}x (goal: at most 3)")
    console.print(f"a new episode in a warm worker starts within {result['episode_start_ms']:.0f} ms (goal: 50)")
    console.print(f"two workers by one: {result['workers_speedup']:.2f}x (goal: 1.9)")
    if json_path is not None:
        write_json(json_path, {name: round(figure, 4) for name, figure in result.items()})


def _isolation(planners: tuple[str, ...], limit: int, rounds: int, json_path: Path | None) -> None:
    found = benches.bench_isolation(planners or benches.PLANNERS, limit, rounds)
    rows = []
    for one in found:
        told = ("-", "-", "-")
        if one.together_us is not None:
            more = one.isolated_us - one.together_us
            told = (f"{one.together_us:.0f}", f"{more:.0f}", "met" if more <= benches.GOAL_US else "not met")
        rows.append((one.planner, told[0], f"{one.isolated_us:.0f}", *told[1:], f"{one.apart_us:.0f}"))
    heads = (
        "planner",
        "µs together",
        "µs isolated",
        "difference",
        f"goal: {benches.GOAL_US:.0f}",
        "µs on another processor",
    )
    print_table(heads, rows, title="median time of an answer")
    if json_path is not None:
        write_json(json_path, {one.planner: asdict(one) for one in found})


def _fresh(limit: int, rounds: int, json_path: Path | None) -> None:
    price = benches.bench_fresh(limit, rounds)
    more = price["in_child_ms"] - price["together_ms"]
    met = "met" if more <= benches.GOAL_MS else "not met"
    figures = (f"{ms:.1f}" for ms in (*price.values(), more))
    heads = ("ms in the worker", "ms in a child", "difference", f"goal: {benches.GOAL_MS:.0f}")
    print_table(heads, [(*figures, met)], title="processor time of an episode")
    if json_path is not None:
        write_json(json_path, price)


def _networks(json_path: Path | None) -> None:
    found = list(benches.bench_networks())
    rows = [(name, f"{alone:.2f}", f"{together:.2f}") for name, alone, together in found]
    print_table(("network", "ms alone", "ms each of eight"), rows, title="CPU time of an answer")
    whole = benches.bench_whole()
    Console().print(f"a tick of {benches.WHOLE}'s whole episodes: {whole:.2f} ms of CPU")
    figures = {name: {"alone_ms": round(a, 4), "of_eight_ms": round(b, 4)} for name, a, b in found}
    figures[benches.WHOLE]["tick_ms"] = round(whole, 4)
    if json_path is not None:
        write_json(json_path, figures)


def _environment(rounds: int, json_path: Path | None) -> None:
    from tsbench.learn.envs.env_speed import BLOCK, rates_of, vectorised

    goals = {"vector": 1500, "scene": 800}
    figures = {kind: (*rates_of(kind, rounds * BLOCK), vectorised(kind, rounds * BLOCK)) for kind in goals}
    rows = [(kind, *(f"{rate:,.0f}" for rate in rates), f"{goals[kind]:,}") for kind, rates in figures.items()]
    heads = ("observation", "steps/s per core", "with episode starts", "two in AsyncVectorEnv", "goal")
    print_table(heads, rows, title="environment")
    if json_path is not None:
        write_json(
            json_path,
            {kind: {"steps_per_s": a, "with_starts": b, "vectorised": c} for kind, (a, b, c) in figures.items()},
        )
