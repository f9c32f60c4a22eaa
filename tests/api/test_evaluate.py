"""`tsbench.evaluate`: the same options as the command line, planners by name or by class, and who is told."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tsbench
from tsbench.api.evaluate import spec_of
from tsbench.cli.run import run as command
from tsbench.core.errors import InputError
from tsbench.run.options import RunOptions, from_python, number_of, type_words, whole_number

SCRIPT = """
import tsbench

class Mine:
    def reset(self, context): pass
    def act(self, observation): return tsbench.Control(-3.0, 0.0)

{guard}print(tsbench.evaluate(Mine, split="dev", types="speed_limit", limit=2, workers=1, out="run"))
"""


def test_it_takes_what_the_command_takes_with_the_same_defaults() -> None:
    options = {p.opts[0].removeprefix("--").replace("-", "_"): p for p in command.params}
    taken = inspect.signature(tsbench.evaluate).parameters
    assert {"planner", "listener"} <= set(options)
    assert set(taken) - {"listeners"} == set(options) - {"listener"}
    for name in set(taken) - {"planner", "listeners", "types", "split", "city"}:
        default = options[name].to_info_dict()["default"]
        assert taken[name].default == (default or None if name in ("limit", "out", "workers") else default), name


def test_the_command_and_python_give_the_same_values() -> None:
    """An interrupted run is continued by either only if its options have the same text in `run.json`."""
    given = command.make_context("run", ["--planner", "idm", "--split", "dev", "--memory-limit", "600"]).params
    theirs = RunOptions(city=given.pop("data").name, **given)
    ours = RunOptions(**from_python(RunOptions, {"planners": ("idm",), "split": "dev", "memory_limit": 600}))
    assert json.dumps(theirs.plain()) == json.dumps(ours.plain())


def test_a_run_and_who_is_told(run: tsbench.Run, told: Any) -> None:
    assert (run.planners, run.status, len(run.episodes)) == (("idm", "Parked"), "complete", 4)
    begin, *rows, end = told.heard
    assert begin.folder == end.folder == run.path
    assert begin.asked == {"idm": 2, "Parked": 2}
    assert begin.options["types"] == ("speed_limit",)
    assert sorted(rows) == sorted(run.episodes.scenario_id)
    assert end.summary is not None


def test_the_same_call_reads_what_is_complete(run: tsbench.Run, told: Any) -> None:
    heard = type(told)()
    options = {name: run.options[name] for name in ("split", "types", "limit", "trace", "workers", "out")}
    again = tsbench.evaluate(run.options["planners"], listeners=[heard], **options)
    assert again.path == run.path
    assert [type(one).__name__ for one in heard.heard] == ["Started", "RunResult"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"split": "exam"}, "split exam: expected"),
        ({"trace": "al"}, "trace al: expected none, violations, all"),
        ({"trace": None}, "trace None: expected none, violations, all"),
        ({"mask_signs": None}, "mask_signs None: expected True or False"),
        ({"memory_limit": None}, "memory_limit None: expected a number"),
        ({"device": "tpu"}, "device tpu: expected"),
        ({"executor": "slurm"}, "executor slurm: expected"),
        ({"workers": 0}, "workers 0: expected at least 1"),
        ({"memory_limit": 511}, "memory_limit 511: expected at least 512"),
        ({"types": "speling"}, "types speling: no such type"),
        ({"types": []}, "types []: names no type"),
        ({"types": " , "}, "types ' , ': names no type"),
        ({"types": [1]}, "types [1]: expected types and groups"),
        ({"types": 1}, "types 1: expected types and groups"),
        ({"workers": 1.5}, "workers 1.5: expected a whole number"),
        ({"workers": "2"}, "workers '2': expected a whole number"),
        ({"workers": True}, "workers True: expected a whole number"),
        ({"limit": 2.0}, "limit 2.0: expected a whole number"),
        ({"limit": 0}, "limit 0: expected at least 1"),
        ({"memory_limit": "x"}, "memory_limit 'x': expected a number"),
        ({"memory_limit": float("nan")}, "memory_limit nan: expected a number"),
        ({"out": 3}, "out 3: expected a path"),
        ({"out": ""}, "out: is empty: name a file or a folder"),
        ({"city": "atlantis"}, "city atlantis: no such city; there are andorra, "),
        ({"executor": "ray", "isolate": True}, "isolate=True: planners are isolated on this machine"),
        ({"types": "detour_left", "city": "krems"}, "tsbench city build krems --osm DIR"),
        ({"city": 3}, "city 3: expected text"),
        ({"image": 3}, "image 3: expected text"),
        ({"isolate": "no"}, "isolate 'no': expected True or False"),
        ({"mask_signs": "yes"}, "mask_signs 'yes': expected True or False"),
        ({"allow_partial": 1}, "allow_partial 1: expected True or False"),
        ({"listeners": 3}, "listeners 3: expected a list of listeners"),
        ({"listeners": [3]}, "listeners: 3: expected an object with started, episode, finished"),
    ],
)
def test_what_the_command_refuses(options: dict[str, Any], words: str, folder: Path) -> None:
    with pytest.raises(InputError) as told:
        tsbench.evaluate("idm", **{"split": "dev", **options})
    assert words in str(told.value)
    assert not str(told.value).startswith("--")
    assert not list(folder.iterdir())


def test_what_other_calls_refuse() -> None:
    for call, words in (
        (lambda: tsbench.load_scenarios("dev", types=[]), r"types \[\]: names no type"),
        (lambda: tsbench.load_scenarios("dev", city=3), "city 3: expected text"),  # type: ignore[arg-type]
        (lambda: tsbench.load_run(3), "run 3: expected a path"),  # type: ignore[arg-type]
    ):
        with pytest.raises(InputError, match=words):
            call()


def test_numbers_of_numpy_are_numbers() -> None:
    assert whole_number("n", np.int64(3)) == 3
    assert type(whole_number("n", np.int64(3))) is int
    assert number_of("x", np.float32(2.5), 1) == 2.5
    assert type_words("types", ("stop", "yield, ")) == ("stop", "yield,")
    assert type_words("types", "stop, yield ,") == ("stop", "yield")
    assert type_words("types", None) == ()


def test_a_class_or_function_of_a_file_has_a_name() -> None:
    assert spec_of(Mine) == f"{__name__}:Mine"
    assert spec_of(Mine.Inner) == f"{__name__}:Mine.Inner"
    assert spec_of(drive) == f"{__name__}:drive"
    assert spec_of("idm-e") == "idm-e"


def test_what_no_process_can_import() -> None:
    class Local:
        pass

    for planner in (Local, lambda o: o):
        with pytest.raises(InputError, match="cannot import it, as it is not at the top of a file"):
            spec_of(planner)
    with pytest.raises(InputError, match="expected a name, a class or a function, not Mine"):
        spec_of(Mine())  # type: ignore[arg-type]


class Mine:
    class Inner:
        pass


def drive(observation: object) -> None:
    pass


def run_python(*arguments: str, cwd: Path, text: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], cwd=cwd, input=text, capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize("given", [["mine.py"], ["-m", "mine"]])
def test_a_class_of_a_script(given: list[str], tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(SCRIPT.format(guard='if __name__ == "__main__": '))
    done = run_python(*given, cwd=tmp_path)
    assert done.stdout == "Run('run': Mine; 2 of 2 episodes, complete)\n", done.stderr


def test_a_script_that_would_call_itself_without_end(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(SCRIPT.format(guard=""))
    done = run_python("mine.py", cwd=tmp_path)
    assert 'put it below if __name__ == "__main__":' in done.stderr.splitlines()[-1]


def test_a_class_that_was_typed_in(tmp_path: Path) -> None:
    done = run_python("-", cwd=tmp_path, text=SCRIPT.format(guard=""))
    assert "%%writefile planner.py" in done.stderr.splitlines()[-1]
    assert not list(tmp_path.iterdir())
