"""The README's own planner, by its own commands, in an empty folder: checked, driven, its violations filmed."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SECTION = re.split(r"^## Your own planner$", README, flags=re.M)[1].split("\n## ")[0]
PLANNER = re.findall(r"^```python\n(.*?)^```", SECTION, re.M | re.S)
FILMED = ["planners", "run", "failures", "render"]
COMMANDS = [re.split(r"\s+#", line)[0] for line in re.findall(r"^(tsbench .*)$", SECTION, re.M)]


def test_the_readme_has_one_planner_and_says_what_to_do_with_it() -> None:
    assert len(PLANNER) == 1
    assert [shlex.split(line)[1] for line in COMMANDS] == [*FILMED, "run", "compare"]
    assert all("my_planner.py:Minimal" in line for line in (*COMMANDS[:2], COMMANDS[4]))
    example = (ROOT / "examples/minimal_planner.py").read_text(encoding="utf-8")
    assert "class Minimal:" in example
    body = PLANNER[0].split("class Minimal:")[1].strip()
    assert body in example, "examples/minimal_planner.py is another planner than the README's"


@pytest.mark.slow
def test_from_the_readme_to_a_film_of_a_violation(tmp_path: Path) -> None:
    (tmp_path / "my_planner.py").write_text(PLANNER[0], encoding="utf-8")
    environment = {"PYTHONPATH": str(ROOT), "PATH": os.environ["PATH"], "HOME": str(tmp_path)}
    # The last two drive all of dev.
    for line in COMMANDS[: len(FILMED)]:
        done = subprocess.run(
            [sys.executable, "-c", "from tsbench.cli import main; main()", *shlex.split(line)[1:]],
            cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, line + "\n" + done.stdout + done.stderr
    films = list(tmp_path.rglob("*.mp4"))
    assert films
    # What players know an MP4 by.
    assert all(film.read_bytes()[4:8] == b"ftyp" and film.stat().st_size > 20_000 for film in films)
