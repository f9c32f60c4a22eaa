"""No number that decides a verdict stands in the code of the rules: they are data, in `sign_catalog/rules`."""

from __future__ import annotations

import ast
from pathlib import Path

import tsbench.rules

FOLDER = Path(tsbench.rules.__file__).parent
# What may stand anywhere: nothing, one, halves and doubles, and what floats miss by.
PLAIN = {0, 0.5, 1, 2}
LEAST = 1e-5
# What else stands where, and why no verdict depends on its value.
NO_THRESHOLD = {
    ("speed.py", 3.6): "km/h of a m/s",
    ("crossing.py", 6.0): "how far a tick's place on the path is looked for, m: a tick is 2 m at 20 m/s",
    ("give_way.py", 100.0): "rounds distances to centimetres where exact ties go by order",
    ("open_speed.py", 10.0): "how far along a path its bend is measured, m",
    ("open_speed.py", 0.001): "what counts as straight there, rad: no bend slows anybody",
}


def numbers(path: Path) -> set[float]:
    found = {
        node.value
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and type(node.value) in (int, float)
    }
    return {n for n in found if n not in PLAIN and abs(n) >= LEAST}


def test_numbers_in_the_rules_are_units_and_resolutions() -> None:
    found = {(path.name, number) for path in FOLDER.glob("*.py") for number in numbers(path)}
    assert found <= set(NO_THRESHOLD), found - set(NO_THRESHOLD)


def test_a_threshold_in_code_would_be_found(tmp_path: Path) -> None:
    path = tmp_path / "rule.py"
    path.write_text("FAST_KMH = 61.5\nEVEN = 2\nTINY = 1e-9\n", encoding="utf-8")
    assert numbers(path) == {61.5}
