"""What stands behind `--planner`: names, modules, files, functions, and every way to get it wrong."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from command_line import one_line

import tsbench
from tsbench.core.errors import InputError
from tsbench.planners import registry
from tsbench.planners.base import Planner
from tsbench.planners.builtin import REIMPLEMENTED, THIRD_PARTY, origin
from tsbench.planners.experts.expert import Expert

GOOD = """
from tsbench.planners.base import Control

class Mine:
    privileged = True
    def reset(self, context): pass
    def act(self, observation): return Control(0.0, 0.0)

def steady(observation): return Control(1.0, 0.0)

class NoAct:
    def reset(self, context): pass

class WrongAct:
    def reset(self, context): pass
    def act(self): pass

class NeedsMore:
    def __init__(self, what): pass
    def reset(self, context): pass
    def act(self, observation): pass

def two(a, b): pass

number = 3
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(GOOD)
    return path


# Made of what tsbench does not bring: one line says how to get it.
FOREIGN = {
    "metadrive-ppo": r"pip download --no-deps metadrive-simulator==0\.4\.3",
    "commonroad-reactive": r"It needs the extra `commonroad` in an environment of its own",
}
READERS = ("reader", "careful", "cautious", "elderly", "assertive")
OWN = [name for name in registry.names() if name not in FOREIGN]


@pytest.mark.parametrize("name", OWN)
def test_every_registered_planner_loads(name: str) -> None:
    loaded = registry.resolve(name)
    assert loaded.name == loaded.spec == name
    made, entry = loaded.factory(), registry.entry(name)
    assert isinstance(made, Planner)
    assert loaded.privileged is (name.endswith("-e") or name in READERS)
    assert getattr(made, "privileged", False) == entry.privileged
    assert getattr(made, "sign_access", True) == entry.sign_access


@pytest.mark.parametrize("name", FOREIGN)
def test_who_lacks_what_others_made_is_told_how_to_get_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TSBENCH_METADRIVE", raising=False)
    monkeypatch.setitem(sys.modules, "commonroad_rp", None)
    for module in [one for one in sys.modules if one.startswith("tsbench.bridges.commonroad")]:
        monkeypatch.delitem(sys.modules, module)
    with one_line(match=FOREIGN[name]):
        registry.resolve(name).factory()


def test_whose_work_a_planner_is_stands_in_its_entry() -> None:
    kinds = {name: registry.entry(name).kind for name in registry.names()}
    others = {name: kind for name, kind in kinds.items() if kind in (THIRD_PARTY, REIMPLEMENTED)}
    assert others == {"metadrive-ppo": THIRD_PARTY, "commonroad-reactive": THIRD_PARTY, "pdm": REIMPLEMENTED}
    assert {name: origin(name) for name in kinds} == {name: others.get(name, "") for name in kinds}
    assert origin("mine.py:pdm") == ""


EXPERTS = """
from tsbench.planners.base import Control

class Slow:
    follows_route = True
    def reset(self, context): self.told = context.privilege
    def act(self, observation): return Control(-1.0, 0.0)

class Wanderer(Slow):
    chooses_route = True

class Told(Slow):
    privileged = True

def steady(observation): return Control(1.0, 0.0)
"""


def test_every_planner_that_follows_a_route_has_an_expert(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "bases.py").write_text(EXPERTS)
    monkeypatch.chdir(tmp_path)
    for spec in ("bases:Slow-e", "bases.py:Slow-e", f"{tmp_path / 'bases.py'}:steady-e"):
        loaded = registry.resolve(spec)
        assert (loaded.name, loaded.spec) == (f"{spec.rpartition(':')[2]}", spec)
        assert loaded.privileged
        assert loaded.sources[-1] == "tsbench.planners.experts.expert"
        assert isinstance(loaded.factory(), Expert)
    assert registry.names() == (
        "assertive", "blind", "careful", "carl", "carl-e", "cautious", "codes", "coin", "commonroad-reactive",
        "elderly", "idm", "idm-e", "idm-s1", "idm-s1-e", "idm-s2", "idm-s2-e", "idm-s3", "idm-s3-e",
        "idm-s4", "idm-s4-e", "metadrive-ppo", "pdm", "plant2", "plant2-blind", "plant2-e", "plant2-ft",
        "plant2-ft-seed1", "ppo", "ppo-e", "reader",
    )  # fmt: skip
    assert registry.resolve("carl-e").batched is registry.resolve("carl").batched


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("plant2-ft-e", "plant2-ft chooses its way by itself and follows no route"),
        ("bases:Wanderer-e", "chooses its way by itself"),
        ("bases:Told-e", "is told the rule already"),
        ("idm-e-e", "no such planner"),
        ("idn-e", "did you mean idm-e"),
    ],
)
def test_who_can_have_no_expert_says_why(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spec: str, words: str
) -> None:
    (tmp_path / "bases.py").write_text(EXPERTS)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "bases", raising=False)
    with pytest.raises(InputError, match=words):
        registry.resolve(spec)


def test_a_class_by_module_file_and_a_function(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    by_file = registry.resolve(f"{file}:Mine")
    assert by_file.name == "Mine"
    assert by_file.privileged
    monkeypatch.chdir(file.parent)
    # Modules stay imported, and folders on the path: no other test has one of this name.
    (file.parent / "named_once.py").write_text(file.read_text())
    assert registry.resolve("named_once:Mine").name == "Mine"
    function = registry.resolve(f"{file}:steady").factory()
    assert isinstance(function, Planner)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("idn", ["no such planner", "did you mean", "idm"]),
        (
            "zzzz",
            [
                "no such planner",
                "registered are assertive, blind, careful, carl, carl-e, cautious, codes, coin, commonroad-reactive,",
            ],
        ),
        ("no_such_package.thing:Class", ["there is no module no_such_package"]),
        ("tsbench.planners.idm:Nope", ["has no Nope", "Idm"]),
        ("missing.py:Mine", ["there is no file missing.py"]),
        ("missing.py", ["name the class or function", "missing.py:MyPlanner"]),
        (":Mine", ["expected a registered name"]),
        ("tsbench.planners.idm:", ["expected a registered name"]),
        ("{file}:NoAct", ["no method act"]),
        ("{file}:WrongAct", ["act must take one argument (observation)"]),
        ("{file}:NeedsMore", ["constructible without arguments"]),
        ("{file}:two", ["function must take one argument"]),
        ("{file}:number", ["a int is no planner"]),
    ],
)
def test_every_mistake_is_one_line_that_says_what(spec: str, words: list[str], file: Path) -> None:
    with one_line(*words):
        registry.resolve(spec.format(file=file))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x = 1\nimport no_such_thing\n", ["no_such_thing", "line 2"]),
        ("def f(:\n", ["SyntaxError", "line 1"]),
        ("\n\n1 / 0\n", ["ZeroDivisionError", "line 3"]),
        ("raise SystemExit(3)\n", ["SystemExit: 3", "line 1"]),
        ("raise ValueError('a\\nb')\n", ["ValueError: a b", "line 1"]),
    ],
)
def test_a_file_that_does_not_import_names_file_and_line(tmp_path: Path, text: str, words: list[str]) -> None:
    path = tmp_path / "broken.py"
    path.write_text(text)
    with one_line("does not import", str(path), *words):
        registry.resolve(f"{path}:Mine")


def test_only_what_can_be_installed_is_said_to_be(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    for line, told in (
        ("import tsbench.nowhere", f"tsbench {tsbench.__version__} has no such module"),
        ("import really_absent.part", "to install it: pip install really-absent"),
        ("from math import nowhere", ""),
    ):
        path.write_text(line)
        with pytest.raises(InputError) as caught:
            registry.resolve(f"{path}:Mine")
        assert str(caught.value).endswith(told)
        assert ("pip install" in str(caught.value)) == ("pip install" in told)


def test_a_module_whose_own_import_fails_names_the_line_of_the_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "outer_planner.py").write_text("import inner_planner\n")
    (tmp_path / "inner_planner.py").write_text("\n\n\nimport really_absent\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"inner_planner\.py, line 4"):
        registry.resolve("outer_planner:Mine")
