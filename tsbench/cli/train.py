"""`tsbench train`: learn a planner's weights on the train split; and how weights drive."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from tsbench.cli import options
from tsbench.cli.console import table_console
from tsbench.cli.options import POSITIVE, Option, Words, several
from tsbench.core.errors import InputError
from tsbench.core.files import write_atomic
from tsbench.core.machine import own_cores
from tsbench.episode.perception_level import load_level
from tsbench.learn.imitation.frames_store import TrainingResources
from tsbench.learn.imitation.recipe import (
    FineTuning,
    ImitationRecipe,
    drive,
    finetune_drives,
    skill_of,
    validation_rows,
)
from tsbench.learn.oracle.trajectories import trajectories_path
from tsbench.learn.plant2.plant2_planner import StopPolicy
from tsbench.metrics.intervals import share_ends
from tsbench.planners.floor.guess import Plate
from tsbench.planners.weights import Network, network
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.scenarios.spec import CONTRAST, SIGNED, ScenarioSpec
from tsbench.scenarios.store import check_files

if TYPE_CHECKING:
    from tsbench.learn.imitation.task import ImitationTask

_cache_gb = click.option(
    "--cache-gb", default=8.0, show_default=True, type=click.FloatRange(min=0.1), help="Bound of frames on disk."
)


def _rate(default: float | None, help: str = "Learning rate.") -> Option:
    kind = click.FloatRange(min=0.0, min_open=True)
    return click.option("--rate", default=default, show_default=True, type=kind, help=help)


def _out(default: str) -> Option:
    told = "Folder of the training; what it holds of it already is continued."
    return options.out(told, default, type=options.FOLDER)


@click.group()
def train() -> None:
    """Train a planner on the train split; a folder that holds part of the training is continued."""


def _reinforcement(steps: int, out: str) -> Option:
    return several(
        options.count(
            "--steps", default=steps, help="Decisions (0.3 s each) in all, those of earlier sessions included."
        ),
        click.option(
            "--workers",
            type=POSITIVE,
            default=lambda: 4 * own_cores(),
            show_default="four per core",
            metavar="N",
            help="Processes that drive, one simulation each.",
        ),
        click.option(
            "--imitation",
            type=click.IntRange(min=0),
            metavar="N",
            help="Rollouts of imitation before that, those of earlier sessions included. Default: the planner's.",
        ),
        _rate(None, "Learning rate that this session begins with; it falls to a tenth. Default: the planner's."),
        several(options.more, options.seed, options.types, options.device, _out(out)),
    )


@train.command(short_help="PPO on 275 numbers: ego, navigation, neighbours, lidar.")
@_reinforcement(steps=3_000_000, out="runs/train-ppo")
def ppo(**asked: Any) -> None:
    """PPO on 275 numbers with an MLP; writes ppo.safetensors and ppo.json."""
    _train("ppo", **asked)


@train.command(short_help="PPO on a bird's-eye raster, with the reward of CaRL.")
@_reinforcement(steps=1_000_000, out="runs/train-carl")
def carl(**asked: Any) -> None:
    """PPO on a bird's-eye raster with a CNN; writes carl.safetensors and carl.json."""
    _train("carl", **asked)


def _train(planner: str, out: Path, **asked: Any) -> None:
    from tsbench.learn.rl import ppo_training  # brings torch

    job = ppo_training.Job(planner, out, **asked)
    # Its processes read the rows themselves; what they lack is said before they start.
    _train_rows(job.types)
    options.types_of(DataSet(), job.more, "--more")
    _tell(out, ppo_training.train(job, click.echo))


@train.command(short_help="Imitation of sign-blind driving by a transformer.")
@options.choice("--size", ("mini", "medium"), "mini")
@options.count("--drives", "episodes", default=4000, help="To learn from, types in turn.")
@options.count("--epochs", default=12, help="Passes over their frames.")
@options.planners("Who is imitated, in turn", default=("idm",))
@options.count("--batch", default=256, help="Frames of a step.")
@_rate(6e-4)
@options.count("--validation", default=160, help="Episodes driven after each epoch; the best network is kept.")
@several(options.types, options.seed, options.device, options.workers, _cache_gb, _out("runs/train-plant2"))
def plant2(
    planners: Words, types: Words, device: str, workers: int, cache_gb: float, out: Path, **figures: Any
) -> None:
    """Imitation of sign-blind driving; writes plant2.safetensors and plant2.json."""
    from tsbench.learn.imitation.task import imitation  # brings torch

    recipe = ImitationRecipe(drivers=planners, types=types, **figures)
    _learn(imitation(recipe, _train_rows(types)), out, device, workers, cache_gb)


def _learn(task: ImitationTask, out: Path, *resources: Any) -> None:
    from tsbench.learn.imitation.trainer import train as learn

    _tell(out, learn(task, _resources(out, *resources), click.echo))


def _lessons(drives: int, out: str) -> Option:
    """The options that say which drives are learned from, and with what."""
    return several(
        several(
            options.trajectories,
            options.planners("Expert that drives anew instead, in turn"),
            options.count("--drives", default=drives, help="To learn from, types in turn; 0: all.", least=0),
            options.more,
        ),
        click.option(
            "--student",
            type=options.FOLDER,
            metavar="DIR",
            help="Folder of plant2-ft's weights that begin a share of the drives; --demonstrator ends them.",
        ),
        click.option("--takeover", default=0.3, show_default=True, type=click.FloatRange(0.0, 1.0), help="That share."),
        click.option(
            "--demonstrator", "expert", type=options.TEXT, default="idm-e", show_default=True, metavar="PLANNER"
        ),
        click.option(
            "--mask-signs",
            is_flag=True,
            help="Show posts in place of plates, in training and validation: the floor plant2-blind, whose weights are "
            "meant then wherever plant2-ft's are.",
        ),
        options.perception("Level of the eyes through which a share of the drives is seen."),
        click.option(
            "--perceived", default=0.3, show_default=True, type=click.FloatRange(0.0, 1.0), help="That share."
        ),
        several(options.types, options.seed, options.workers, _cache_gb, _out(out)),
    )


@train.command("plant2-ft", short_help="Fine-tuning of plant2 on obedient drives.")
@click.option(
    "--base",
    type=options.FOLDER,
    metavar="DIR",
    help="Folder of the plant2 or plant2-ft weights to begin with; default: tsbench's own plant2.",
)
@options.count("--epochs", default=26, help="Passes over their frames.")
@options.count("--batch", default=128, least=8, help="Frames of a step.")
@_rate(1e-4)
@options.count("--validation", default=58, help="Episodes driven after each epoch; the network with most SCD is kept.")
@options.device
@_lessons(drives=0, out="runs/train-plant2-ft")
def plant2_ft(device: str, workers: int, cache_gb: float, out: Path, **asked: Any) -> None:
    """Fine-tuning of plant2 on obedient drives; writes plant2-ft.safetensors and plant2-ft.json.

    With --mask-signs they are plant2-blind.safetensors and plant2-blind.json.
    """
    from tsbench.learn.imitation.task import fine_tuning  # brings torch

    recipe, rows = _recipe(**asked)
    _learn(fine_tuning(recipe, rows), out, device, workers, cache_gb)


@train.command(short_help="Look at what plant2-ft is shown.")
@_lessons(drives=290, out="runs/frames")
def frames(workers: int, cache_gb: float, out: Path, **asked: Any) -> None:
    """What plant2-ft is shown: counts, targets, and ten frames of each group as pictures."""
    from tsbench.learn.imitation.drives_report import report

    recipe, rows = _recipe(**asked)
    for path in report(finetune_drives(rows, recipe), recipe, _resources(out, "cpu", workers, cache_gb), click.echo):
        click.echo(path)


def _recipe(
    planners: Words, types: Words, more: Words, trajectories: Path | None, perception: str, **figures: Any
) -> tuple[FineTuning, list[ScenarioSpec]]:
    path, often = trajectories or trajectories_path(), options.types_of(DataSet(), more, "--more")
    recipe = FineTuning(
        trajectories=path, drivers=planners, types=types, more=often, perception=load_level(perception), **figures
    )
    return recipe, _train_rows(types)


@train.command(short_help="Count which plates stand in which half of train's pairs.")
@options.out("Where the counts go.", "runs/codes.csv", type=options.FILE)
def codes(out: Path) -> None:
    """Which plates stand in signed and in contrast halves of the train split: all that the floor codes knows."""
    write_counts(count_plates(_train_rows(())), out)
    click.echo(out)


# Of `Skill`, with heads that leave 80 columns for the types' names.
_SHARES = {
    "arrived": "ar-\nrived",
    "collision": "col-\nlision",
    "off_road": "off\nroad",
    "timeout": "time-\nout",
    "compliant": "com-\nplied",
    "scd": "SCD",
}


@train.command(short_help="How plant2's, plant2-ft's or plant2-blind's weights drive on kept-out maps.")
@click.argument("folder", type=options.FOLDER, required=False)
@options.choice("--planner", ("plant2", "plant2-ft", "plant2-blind"), "plant2-ft")
@options.count("--each", default=4, help="Episodes of a type.")
@click.option(
    "--stop-policy",
    type=(float,) * 5,
    metavar="SHARE WAITS RISE HOLD BRAKES",
    help="Of plant2-ft, instead of its own: from which share of standing it halts, what is added to that "
    "each second (1/s) after a wait of so many seconds, how many seconds a halt lasts beyond the last such plan, and "
    "its least deceleration (m/s2).",
)
@several(options.types, options.seed, options.workers)
def measure(
    folder: Path | None,
    planner: str,
    each: int,
    stop_policy: tuple[float, ...] | None,
    types: tuple[str, ...],
    seed: int,
    workers: int,
) -> None:
    """How the weights in FOLDER (default: tsbench's own) drive on kept-out maps of the train split, by type."""
    network(planner, folder)
    if stop_policy and planner == "plant2":
        raise InputError(f"--stop-policy: {planner} has none")
    rows = _train_rows(types)
    kinds = sorted({row.pair_type for row in rows})
    rows = [row for kind in kinds for row in validation_rows([r for r in rows if r.pair_type == kind], each, seed)]
    ends = drive(planner, folder, rows, workers, StopPolicy(*stop_policy) if stop_policy else None)
    heads = ("type", "n", *_SHARES.values())
    table = Table(*heads, box=SIMPLE_HEAD, title="shares of episodes, %", title_justify="left")
    skills = {
        kind: skill_of([end for row, end in zip(rows, ends, strict=True) if row.pair_type == kind]) for kind in kinds
    }
    skills["all"] = whole = skill_of(ends)
    for name, skill in skills.items():
        shares = (f"{100.0 * getattr(skill, share):.1f}" for share in _SHARES)
        table.add_row(name, str(skill.episodes), *shares)
    table_console().print(table)
    (low,), (high,) = share_ends(np.array([whole.scd]), np.array([float(whole.episodes)]))
    click.echo(f"SCD {100.0 * whole.scd:.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f}, 95 % interval)")


def _train_rows(words: tuple[str, ...]) -> list[ScenarioSpec]:
    """The train table's rows of some types and groups, whose files are there."""
    data = DataSet()
    rows = options.rows_of(data, "train", words)
    check_files(rows, data)
    return rows


def _resources(out: Path, device: str, workers: int, cache_gb: float) -> TrainingResources:
    return TrainingResources(out, device, workers, int(cache_gb * 1e9))


def _tell(out: Path, made: Network) -> None:
    weights = f"{made.weights.size / 1e6:.1f} MB, {made.parameters:,} parameters"
    click.echo(f"weights   {out / made.weights.file} ({weights})")
    click.echo(f"facts     {out / made.name}.json")
    click.echo(f"curve     tensorboard --logdir {out / 'tensorboard'}")


def plates_of(row: ScenarioSpec, loader: SceneLoader) -> tuple[Plate, ...]:
    """Code and value of every plate of a row's scene, one entry a plate."""
    return tuple((sign.code, sign.value) for sign in loader.layout(row)[1].signs)


def count_plates(rows: Iterable[ScenarioSpec]) -> dict[Plate, tuple[int, int]]:
    """Signed and contrast halves in which a plate stands, of rows that have a pair."""
    loader = SceneLoader(DataSet())
    there: dict[str, Counter[Plate]] = {SIGNED: Counter(), CONTRAST: Counter()}
    for row in rows:
        if row.pair_id:
            there[row.half].update(set(plates_of(row, loader)))
    every = sorted({*there[SIGNED], *there[CONTRAST]}, key=lambda plate: (plate[0], plate[1] or 0.0))
    return {plate: (there[SIGNED][plate], there[CONTRAST][plate]) for plate in every}


def write_counts(counted: Mapping[Plate, tuple[int, int]], path: Path) -> None:
    """The file that the planner reads: code, value (km/h, empty for none), signed, contrast."""
    lines = [
        f"{code},{'' if value is None else f'{value:g}'},{signed},{contrast}"
        for (code, value), (signed, contrast) in counted.items()
    ]
    write_atomic(path, "\n".join(["code,value,signed,contrast", *lines, ""]).encode("ascii"))
