"""Trainings that are killed outright and asked for again by the same command."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from patience import HANG_S, eventually

from tsbench.learn.rows import read_rows
from tsbench.planners.weights import load_weights, network

COMMAND = (sys.executable, "-c", "from tsbench.cli import main; main()", "train")
IMITATION = (
    "plant2", "--drives", "4", "--epochs", "2", "--validation", "1", "--batch", "16", "--workers", "1", "--types",
    "speed_limit",
)  # fmt: skip
# `tsbench train` with rollouts of 128 decisions in place of 4,096, and a checkpoint after each.
SMALL = """
import sys
from dataclasses import replace
from tsbench.cli import main
from tsbench.learn.rl import config, train

train.HYPER = {"ppo": replace(config.HYPER["ppo"], rollout=128, batch=64, epochs=1, updates=2)}
train._CHECKPOINT_S = 0.0
if __name__ == "__main__":
    main(["train", *sys.argv[1:]])
"""
# `tsbench train`, killed by itself as soon as it has written a checkpoint: no test has to be quicker than it.
KILLED = """
import os, signal
from tsbench.cli import main
from tsbench.learn.imitation import trainer

save = trainer.save_checkpoint

def save_and_die(*arguments):
    save(*arguments)
    os.killpg(0, signal.SIGKILL)

trainer.save_checkpoint = save_and_die
if __name__ == "__main__":
    main()
"""
REINFORCEMENT = ("ppo", "--imitation", "1", "--workers", "1", "--types", "speed_limit")


def kill(command: tuple[str, ...], when: Callable[[], bool]) -> None:
    """Start a command and kill it, with all its processes, as soon as `when` holds."""
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    eventually(when, process)
    os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL


def said(command: tuple[str, ...]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


@pytest.mark.slow
def test_imitation_comes_to_the_weights_of_an_undisturbed_one(tmp_path: Path) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    said((*COMMAND, *IMITATION, "--out", str(whole)))
    # Frames are a cache: what is there is not driven again.
    shutil.copytree(whole / "frames", broken / "frames")
    killing = (sys.executable, "-c", KILLED, "train", *IMITATION, "--out", str(broken))
    killed = subprocess.run(killing, capture_output=True, check=False, timeout=HANG_S, start_new_session=True)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert (broken / "checkpoint.safetensors").is_file()
    assert "continues in epoch" in said((*COMMAND, *IMITATION, "--out", str(broken)))
    ours, theirs = (load_weights("plant2", folder) for folder in (broken, whole))
    assert all(np.array_equal(ours[name], theirs[name]) for name in theirs)
    assert [row["epoch"] for row in read_rows(broken / "curve.jsonl")] == [1, 2]
    assert all((folder / "curve.png").is_file() for folder in (whole, broken))
    assert network("plant2", broken).training["sessions"] == 2


@pytest.mark.slow
def test_reinforcement_goes_on_from_its_last_checkpoint(tmp_path: Path) -> None:
    script, out = tmp_path / "small.py", tmp_path / "out"
    script.write_text(SMALL, encoding="utf-8")
    command = (sys.executable, str(script), *REINFORCEMENT, "--out", str(out))
    kill((*command, "--steps", "100000"), lambda: len(read_rows(out / "curve.jsonl")) >= 2)
    steps = int(read_rows(out / "curve.jsonl")[-1]["steps"])
    told = said((*command, "--steps", str(steps + 128)))
    assert "continues at" in told
    rows = [int(row["steps"]) for row in read_rows(out / "curve.jsonl")]
    assert rows == sorted(set(rows))
    assert rows[-1] >= steps + 128
    made = network("ppo", out).training
    assert (made["steps"], made["sessions"] >= 2) == (rows[-1], True)
    assert (out / "curve.png").is_file()
