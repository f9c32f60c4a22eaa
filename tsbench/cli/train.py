"""`tsbench train`: learn a planner's weights on the train split."""

from __future__ import annotations

import click

from tsbench.cli import LazyGroup

# Command, where it is, and its line in --help: training brings torch with it.
COMMANDS = {
    "ppo": ("tsbench.cli.train_rl:ppo", "PPO on 275 numbers: ego, navigation, neighbours, lidar."),
    "carl": ("tsbench.cli.train_rl:carl", "PPO on a bird's-eye raster, with the reward of CaRL."),
    "plant2": ("tsbench.cli.train_plant2:plant2", "Imitation of sign-blind driving by a transformer."),
    "plant2-ft": ("tsbench.cli.train_plant2_ft:plant2_ft", "Fine-tuning of plant2 on obedient drives."),
    "frames": ("tsbench.cli.train_plant2_ft:frames", "Look at what plant2-ft is shown."),
    "measure": (
        "tsbench.cli.train_measure:measure",
        "How plant2's or plant2-ft's weights drive on kept-out maps.",
    ),
}


@click.group(cls=LazyGroup, lazy=COMMANDS)
def train() -> None:
    """Train a planner on the train split; a folder that holds part of the training is continued."""
