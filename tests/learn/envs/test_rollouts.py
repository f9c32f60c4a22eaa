"""Equal seeds give equal roll-outs, byte for byte, in processes of either kind."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AsyncVectorEnv

STEPS, SEED = 25, 11


def make() -> gymnasium.Env[Any, Any]:
    return gymnasium.make("tsbench.learn.envs:tsbench/Drive-v0", split="test")


def rolled_out(context: str) -> str:
    actions = np.random.default_rng(SEED).uniform(-0.4, 0.4, (STEPS, 2, 2)).astype(np.float32)
    envs = AsyncVectorEnv([make, make], context=context)
    digest = hashlib.sha256(np.asarray(envs.reset(seed=SEED)[0]).tobytes())
    for action in actions:
        seen, rewards, terminated, _, _ = envs.step(action)
        assert not terminated.any()
        digest.update(np.asarray(seen).tobytes() + rewards.tobytes())
    envs.close()
    return digest.hexdigest()


@pytest.mark.slow
def test_equal_seeds_equal_bytes_under_spawn_and_forkserver() -> None:
    assert rolled_out("spawn") == rolled_out("forkserver")


@pytest.mark.slow
def test_processes_that_run_no_import_of_the_notebook(tmp_path: Path) -> None:
    """The children of `SubprocVecEnv` run a script's imports only where they stand at its top."""
    (tmp_path / "notebook.py").write_text(
        "from stable_baselines3.common.env_util import make_vec_env\n"
        "from stable_baselines3.common.vec_env import SubprocVecEnv\n"
        "if __name__ == '__main__':\n"
        "    several = make_vec_env('tsbench.learn.envs:tsbench/Drive-v1', n_envs=2, vec_env_cls=SubprocVecEnv,\n"
        "                           env_kwargs={'split': 'dev'})\n"
        "    print({len(table) for table in several.reset().values()})\n"
        "    several.close()\n"
    )
    done = subprocess.run([sys.executable, "notebook.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout == "{2}\n", done.stderr


def test_without_its_extra_the_import_says_what_to_install(tmp_path: Path) -> None:
    script = (
        "import sys\nsys.modules['gymnasium'] = None\n"
        "try:\n    import tsbench.learn.envs\nexcept ImportError as problem:\n    print(problem)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout.startswith("this needs gymnasium, which is not installed: pip install 'tsbench[learn]'")
    assert done.stdout.count("\n") == 1
