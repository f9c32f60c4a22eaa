"""The network of `plant2`: its size as published, and answers that do not hang on the company."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner

from tsbench.cli.planners import planners
from tsbench.errors import InputError
from tsbench.planners.plant2 import layout as at
from tsbench.planners.plant2.inference import inference, load, tensors, wished_speed
from tsbench.planners.plant2.network import Plant2Network
from tsbench.planners.plant2.network_ft import Plant2FtNetwork
from tsbench.planners.plant2.parts import PUBLISHED_ADDED, PUBLISHED_MEDIUM, parts
from tsbench.planners.weights import save_weights


def samples(count: int, dtype: np.dtype = at.SIGN_TOKENS) -> at.Records:
    """Streets from empty to full."""
    rng = np.random.default_rng(5)
    batch: at.Records = np.zeros(count, dtype=dtype)
    for k in range(count):
        n = (0, 30, 3, 6, 7, 14, 15, 22)[k % 8]
        batch["kinds"][k, :n] = rng.integers(1, at.OBJECT_CLASSES, n)
        batch["objects"][k, :n] = rng.normal(size=(n, at.OBJECT_FEATURES))
    batch["route"] = rng.normal(size=batch["route"].shape)
    batch["limits"] = rng.uniform(0.5, 2.0, batch["limits"].shape)
    batch["patch"] = rng.integers(0, 256, batch["patch"].shape)
    if "signs" in (dtype.names or ()):
        batch["signs"] = rng.normal(size=batch["signs"].shape)
        batch["sign_classes"] = rng.integers(0, 34, batch["sign_classes"].shape)
        batch["sign_state"] = rng.integers(0, 49, count)
    return batch


def made(kind: type[Plant2Network], size: str = "mini") -> Plant2Network:
    torch.manual_seed(3)
    return kind(size)


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


@pytest.mark.own_process
def test_counts_are_the_published_ones() -> None:
    counted = {part.name: part.parameters for part in parts("medium")}
    assert counted["added by plant2-ft but ways"] == PUBLISHED_ADDED
    assert counted["+ signs"] == 33 * (6 * 512 + 512)
    assert counted["+ sign_state"] == 49 * 512
    # The published total is rounded to 0.1 M; how it is made up was not published.
    assert round(counted["plant2"], -5) == PUBLISHED_MEDIUM
    # BERT-medium's own encoder: 8 layers of width 512 with 2048 in between.
    assert counted["encoder"] == 8 * (4 * (512 * 512 + 512) + 2 * 512 * 2048 + 2048 + 512 + 4 * 512)


@pytest.mark.parametrize("kind", [Plant2Network, Plant2FtNetwork])
def test_plans_do_not_hang_on_the_company(kind: type[Plant2Network]) -> None:
    infer = inference(made(kind))
    batch = samples(8)
    alone = [infer(batch[k : k + 1])[0] for k in range(8)]
    for size in range(2, 9):
        for start in range(0, 8, size):
            rows = list(range(start, min(start + size, 8)))
            for members in (rows, rows[::-1]):
                for k, plan in zip(members, infer(batch[members]), strict=True):
                    assert plan.tobytes() == alone[k].tobytes()


def test_same_company_of_equals_does_not_matter_either() -> None:
    """All in one group: the largest products there are."""
    infer = inference(made(Plant2Network))
    batch = np.repeat(samples(8, at.TOKENS)[1:2], 8)
    plans = [infer(batch[:n])[-1] for n in range(1, 9)]
    assert len({plan.tobytes() for plan in plans}) == 1


def test_empty_slots_and_their_number_change_no_decision_beyond_rounding() -> None:
    net = made(Plant2Network).eval()
    batch = samples(3, at.TOKENS)[2:3]
    with torch.inference_mode():
        few, many = net(tensors(batch, 6)), net(tensors(batch, at.OBJECTS))
    assert torch.allclose(few.path, many.path, atol=1e-5)
    assert few.forecast.shape == (1, 6, 2, 2)


def test_fine_tuning_begins_with_the_bases_weights() -> None:
    base, tuned = made(Plant2Network), made(Plant2FtNetwork)
    assert isinstance(tuned, Plant2FtNetwork)
    tuned.take_over(base)
    own = tuned.state_dict()
    assert all(torch.equal(value, own[name]) for name, value in base.state_dict().items())


def test_speed_is_the_mean_of_its_classes() -> None:
    logits = np.full(len(at.SPEEDS), -40.0)
    logits[2:4] = 0.0
    assert wished_speed(logits) == pytest.approx(((at.SPEEDS[2] + at.SPEEDS[3]) / 2, 0.0))
    logits[0] = 0.0
    assert wished_speed(logits)[1] == pytest.approx(1.0 / 3.0)


def test_foreign_weights_are_refused_in_one_line(tmp_path: Path) -> None:
    save_weights("plant2", tmp_path, {"w": np.zeros(3, dtype=np.float32)}, {"size": "mini"})
    with pytest.raises(InputError, match="are not those of a plant2 network"):
        load("plant2", "cpu", tmp_path)


def test_naming_the_planner_does_not_import_torch() -> None:
    code = (
        "import sys; import tsbench.planners.plant2.planner, tsbench.planners.plant2.planner_ft; "
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.own_process
def test_the_list_prints_counts_beside_the_published_ones() -> None:
    printed = CliRunner().invoke(planners, ["list", "--parts"]).output
    rows = {line.strip().split("  ")[0]: line.split() for line in printed.splitlines() if line.strip()}
    assert rows["plant2"][-3:] == ["37,238,660", "37.2", "M"]
    assert rows["added by plant2-ft but ways"][-2:] == ["147,976", "147,976"]
