"""A rule: its kind declared in one line, numbers, monitor, expert's constraint, cases; nothing lists it again.

The files of this one stand in `tests/extending/no_stopping`. docs/rules.md, "Adding a rule".
"""

from __future__ import annotations

import shutil
from pathlib import Path

from own_copy import ROOT, Copy, records

FILES = Path(__file__).parent / "no_stopping"
WHERE = {
    "rule.yaml": "sign_catalog/rules/no_stopping.yaml",
    "sign.yaml": "sign_catalog/signs/3.27.yaml",
    "monitor.py": "tsbench/rules/no_stopping.py",
    "constraint.py": "tsbench/planners/experts/rules/no_stopping_constraint.py",
    **{f"cases/{path.name}": f"tests/cases/no_stopping/{path.name}" for path in (FILES / "cases").iterdir()},
}
DECLARATION = '    RuleKind("no_stopping", ZoneParams, f"standing_mps standing_s {_ROAD}", "stopped"),\n'
# Stands still once it is 8 s under way.
STOPPER = """
from tsbench import Control, pursue_route

def stop(o):
    return Control(-4.0 if o.time > 8.0 else 0.0, pursue_route(o))
"""


def add_the_rule(clone: Copy) -> None:
    for name, place in WHERE.items():
        clone.write(place, (FILES / name).read_text(encoding="utf-8"))
    clone.add_line("tsbench/signs/rule_kinds.py", '    RuleKind("no_entry"', DECLARATION)
    shutil.copy(ROOT / "sign_catalog/plates/3.2.svg", clone.root / "sign_catalog/plates/3.27.svg")


def test_its_cases_are_judged_as_any_other_rule_s(clone: Copy) -> None:
    add_the_rule(clone)
    for name in ("tests/helpers", "tests/rules", "tests/cases/nets"):
        shutil.copytree(ROOT / name, clone.root / name, ignore=shutil.ignore_patterns("__pycache__"))
    options = ("-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-c", "/dev/null", "--rootdir", ".")
    told = clone.python("-m", "pytest", *options, "tests/rules/test_cases.py", "-k", "no_stopping and case_has")
    assert "3 passed" in told, told


def test_an_episode_is_judged_by_it_and_its_expert_keeps_it(clone: Copy) -> None:
    add_the_rule(clone)
    clone.write("mine.py", STOPPER)
    clone.scene("min_speed", sign_code="3.27", sign_value=None)
    told = clone.tsbench(
        "run --planner mine.py:stop --planner mine.py:stop-e --split test --out run", "signs show 3.27"
    )
    found = records(clone.root / "run")
    assert (found["stop"]["violation_clause"], found["stop"]["violations"]) == ("stopped", 1)
    assert (found["stop-e"]["sign_compliant"], found["stop-e"]["violations"]) == (True, 0)
    assert found["stop-e"]["sign_engaged"] is True
    assert "standing_s" in told
