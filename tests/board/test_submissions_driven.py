"""From the drive to the row: driven isolated, submitted, driven again as on another processor; forgeries are found.

A planner in C always; tsbench's own expert and its network with `pytest -m submissions` (`make submissions`).
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from forgeries import flip_byte
from submitted import TOWN

import tsbench
from tsbench.board.submission import read_submission
from tsbench.board.verification import read_verification
from tsbench.core.files import sha256_of
from tsbench.run.edition import LOCAL, contract_hash, edition_here
from tsbench.scenarios.data_set import DataSet
from tsbench.signs.catalog import load_catalog

ROOT = Path(tsbench.__file__).parent.parent
DEV = DataSet(TOWN).table("dev")
CHANGED = edition_here(contract_hash(DEV, load_catalog()), DataSet(TOWN)).endswith(LOCAL)
ZEROED_BYTES = 4096
SAMPLE = ("--sample", "16", "--seed", "20261", "--workers", "2")
# What a processor without FMA and AVX chooses: the C library's, torch's, MKL's and OpenBLAS' kernels.
OTHER_CPU = {
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2,-FMA4",
    "ATEN_CPU_CAPABILITY": "default",
    "MKL_ENABLE_INSTRUCTIONS": "SSE4_2",
    "OPENBLAS_CORETYPE": "Prescott",
}
PLANNERS = [
    pytest.param("exe", marks=pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler (cc) here")),
    *(pytest.param(name, marks=pytest.mark.submissions) for name in ("idm-e", "plant2-ft")),
]
pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(3600),
    pytest.mark.skipif(CHANGED, reason="code or data were changed since the release: nothing can be submitted"),
]


def command(*arguments: object, expect: int = 0, **settings: str) -> str:
    """What a command of tsbench prints in a process of its own, under these settings of the environment."""
    done = subprocess.run(
        [sys.executable, "-c", "from tsbench.cli import main; main()", *map(str, arguments)],
        env={**os.environ, **settings}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == expect, done.stdout
    return done.stdout


@pytest.fixture(scope="module", params=PLANNERS)
def spec(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    if request.param != "exe":
        return str(request.param)
    binary = tmp_path_factory.mktemp("c") / "follow_route"
    source = ROOT / "examples" / "follow_route.c"
    subprocess.run(["cc", "-O2", "-o", str(binary), str(source), "-lm"], check=True)
    return f"exe:{binary}"


@pytest.fixture(scope="module")
def run(spec: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("driven") / "run"
    command(
        "run",
        "--city",
        TOWN,
        "--planner",
        spec,
        "--split",
        "dev",
        "--isolate",
        "--trace",
        "all",
        "--workers",
        "2",
        "--out",
        out,
    )
    return out


@pytest.fixture(scope="module")
def submitted(run: Path) -> Path:
    path = run.parent / "mine.json"
    assert f"{len(DEV)} judged again from their traces" in command(
        "submit", run, "--authors", "us", "--copy-traces", "2", "--out", path
    )
    return path


def test_an_honest_one_is_confirmed_on_another_processor(submitted: Path, tmp_path: Path) -> None:
    record = tmp_path / "record.json"
    said = command("verify", submitted, *SAMPLE, "--by", "me", "--out", record, **OTHER_CPU)
    assert said.splitlines()[-1] == "confirmed"
    found = read_verification(record)
    assert found.equal + len(found.explained) == 16
    assert found.good
    if "fma" in Path("/proc/cpuinfo").read_text().split():
        # The settings do something, and it is seen.
        theirs = read_submission(submitted).arithmetic["answers"]
        assert found.arithmetic["answers"]["libm"] != theirs["libm"]
    board = tmp_path / "board"
    shutil.copytree(submitted.with_suffix(".traces"), board / "mine.traces")
    for path in (submitted, record):
        shutil.copy(path, board)
    command("leaderboard", "build", board, "--out", tmp_path / "site")
    assert "confirmed" in (tmp_path / "site" / "index.html").read_text()


MINE = '''"""plant2-ft with weights of its own: `plant2-ft.safetensors` and `plant2-ft.json` beside this file."""

from pathlib import Path

from tsbench.learn.plant2.plant2_planner import Plant2Ft


class Mine(Plant2Ft):
    def __init__(self):
        super().__init__(folder=Path(__file__).parent)
'''


def test_other_weights_are_found(tmp_path: Path) -> None:
    """A network's file in which one bit or some numbers differ, and which its description names: another planner."""
    weights = tmp_path / "plant2-ft.safetensors"
    for path in (ROOT / "tsbench" / "planners" / "weights").glob("plant2-ft.*"):
        shutil.copy(path, tmp_path)
    (tmp_path / "mine.py").write_text(MINE)
    planner, out = f"{tmp_path / 'mine.py'}:Mine", tmp_path / "run"
    few = ("--types", "yield", "--split", "dev", "--isolate", "--workers", "1", "--trace", "none")
    command("run", "--city", TOWN, "--planner", planner, *few, "--out", out)
    honest = command("verify", out, "--sample", "2", "--seed", "1", "--workers", "1")
    assert honest.splitlines()[-1] == "confirmed"

    def verified_again() -> str:
        description = json.loads((tmp_path / "plant2-ft.json").read_text())
        description["sha256"] = sha256_of(weights)
        (tmp_path / "plant2-ft.json").write_text(json.dumps(description))
        forged = command("verify", out, "--sample", "2", "--seed", "1", "--workers", "1", expect=1)
        # Its own text names no file of weights, so the hash of its code is the same.
        assert "has other files than as submitted: plant2-ft.json, plant2-ft.safetensors" in forged
        assert forged.splitlines()[-1] == "refuted"
        return forged

    flip_byte(weights, weights.stat().st_size - 64)
    verified_again()  # one bit may leave both episodes as they were
    weights.write_bytes(weights.read_bytes()[:-ZEROED_BYTES] + bytes(ZEROED_BYTES))
    forged = verified_again()
    assert "2 of 2 episodes as submitted" not in forged
    assert "digest is" in forged


@pytest.fixture
def changed(spec: str, tmp_path: Path) -> Callable[[], str]:
    """Makes a program of which one byte is another."""

    def make() -> str:
        binary = Path(shutil.copy(spec.removeprefix("exe:"), tmp_path / "follow_route"))
        flip_byte(binary, binary.read_bytes().rindex(b"GCC:"))  # a remark of the compiler
        return f"exe:{binary}"

    return make
