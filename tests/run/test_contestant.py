"""What stands in a run's manifest about a planner's code."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path

import pytest

import tsbench.planners.idm
from tsbench.errors import InputError
from tsbench.run.contestant import _code_sha256, describe


def test_our_own_planners_are_hashed_with_all_that_they_use() -> None:
    one, expert = describe("idm"), describe("idm-e")
    own = Path(str(tsbench.planners.idm.__file__))
    assert one["code_sha256"] == _code_sha256(own)
    assert one["code_sha256"] != hashlib.sha256(own.read_bytes()).hexdigest()
    # The expert has guards, which idm does not use.
    assert one["code_sha256"] != expert["code_sha256"]


def test_a_planner_of_ones_own_is_its_file(tmp_path: Path) -> None:
    file = tmp_path / "somebodys.py"
    file.write_text("from tsbench import Control\n\ndef drive(o):\n    return Control(0.0, 0.0)\n")
    assert describe(f"{file}:drive")["code_sha256"] == hashlib.sha256(file.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("code", "command"),
    [
        ("import stable_baselines3.no_such", "pip install 'tsbench[learn]'"),
        ("import no_such_package.part", "pip install no-such-package"),
        ("def __init__(self): import tensorboard.no_such", "pip install 'tsbench[learn]'"),
        ("def __init__(self): import no_such_package", "pip install no-such-package"),
    ],
)
def test_what_a_planner_lacks_is_named_with_what_installs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, command: str
) -> None:
    for package in ("stable_baselines3", "tensorboard"):
        # As where the extra is not installed.
        monkeypatch.setitem(sys.modules, package, None)
    lines = [f"    {code}"] if code.startswith("def") else []
    text = "" if lines else f"{code}\n"
    text += "\n".join(["class P:", *lines, "    def reset(self, context): ...", "    def act(self, o): ..."])
    (tmp_path / "lacking.py").write_text(text)
    with pytest.raises(InputError) as told:
        describe(f"{tmp_path / 'lacking.py'}:P")
    assert command in str(told.value)
    assert "lacking.py" in str(told.value)
    assert "\n" not in str(told.value)


def test_a_planner_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    text = "class P:\n    def __init__(self): raise SystemExit('no licence')\n"
    (tmp_path / "unmade.py").write_text(f"{text}    def reset(self, c): ...\n    def act(self, o): ...\n")
    with pytest.raises(InputError, match=r"cannot be made: SystemExit: no licence .*unmade\.py, line 2"):
        describe(f"{tmp_path / 'unmade.py'}:P")
