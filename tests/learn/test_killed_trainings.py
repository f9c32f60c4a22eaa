"""Trainings that are killed outright and asked for again by the same command."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from patience import HANG_S

from tsbench.learn.training_folder import command_line, read_rows
from tsbench.planners.weights import load_weights, network

pytestmark = pytest.mark.slow

COMMAND = (sys.executable, "-c", "from tsbench.cli import main; main()", "train")
IMITATION = (
    "plant2", "--drives", "4", "--epochs", "2", "--validation", "1", "--batch", "16", "--workers", "1", "--types",
    "speed_limit",
)  # fmt: skip
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


def said(command: tuple[str, ...]) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=HANG_S)
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


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


@pytest.mark.parametrize("program", ["/somewhere/bin/tsbench", "/somewhere/tsbench/__main__.py"])
def test_a_command_is_the_same_however_tsbench_was_started(program: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", [program, "train", "plant2", "--seed", "1"])
    assert command_line() == "tsbench train plant2 --seed 1"
