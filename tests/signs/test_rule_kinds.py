"""Every declared kind of rule is there as a whole: whatever attaches to kinds attaches to all of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tsbench.core.errors import InputError, import_all
from tsbench.learn.imitation.targets import TARGET_SPECS
from tsbench.planners.experts.expert import CONSTRAINTS
from tsbench.planners.experts.rules.constraint import RuleConstraint
from tsbench.report.drawing.scene_shapes import rule_zones
from tsbench.rules.monitors import MONITORS
from tsbench.scenarios.data_set import DataSet
from tsbench.scenarios.scene_loader import SceneLoader
from tsbench.signs.catalog import load_catalog
from tsbench.signs.rule_kinds import RULE_KINDS, RuleKind, load_rule_classes

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", RULE_KINDS)
def test_every_kind_is_there_as_a_whole(name: str) -> None:
    assert name in load_catalog().rules
    assert any(sign.rule.name == name for sign in load_catalog().signs.values())
    assert name in MONITORS
    assert name in CONSTRAINTS
    assert name in TARGET_SPECS
    assert list((ROOT / "tests" / "cases" / name).glob("*.yaml"))


def test_every_kind_has_a_zone_to_draw() -> None:
    loader, drawn = SceneLoader(DataSet()), set()
    for row in DataSet().table("test"):
        name = load_catalog().sign(row.sign_code).rule.name
        if name not in drawn:
            scene, _ = loader.load(row)
            kind = RULE_KINDS[name].params
            assert scene.target_signs[0].params is None if kind is None else type(scene.target_signs[0].params) is kind
            (zone,) = rule_zones(scene)
            assert zone.area > 0.0
            drawn.add(name)
    assert drawn == set(RULE_KINDS)


def test_a_kind_without_its_file_or_its_class_is_refused() -> None:
    modules = dict(import_all("tsbench.planners.experts.rules"))
    assert set(load_rule_classes(modules, RuleConstraint, "_constraint")) == set(RULE_KINDS)
    with pytest.raises(ValueError, match=r"constraint\.py: defines 0 StopLike classes, not one$"):
        load_rule_classes(dict.fromkeys(RULE_KINDS, modules["constraint"]), type("StopLike", (), {}))
    del modules["stop_constraint"]
    with pytest.raises(
        ValueError,
        match=r"^rule 'stop' is declared in signs/rule_kinds\.py, but tsbench\.planners\.\S+\.rules has no stop_\S+$",
    ):
        load_rule_classes(modules, RuleConstraint, "_constraint")


def test_a_threshold_says_its_unit() -> None:
    with pytest.raises(ValueError, match="rule fly: threshold 'height' ends with none of s, m,"):
        RuleKind("fly", None, "gap_s height", "")


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("stop.yaml", "stop_speed_mps: 0.2", "stop_speed_mps: 0.2\n  patience_s: 3",
         "thresholds: patience_s: no part of the rule stop reads it"),
        ("stop.yaml", "  stop_speed_mps: 0.2\n", "", "thresholds: stop_speed_mps: is missing"),
        ("give_way.yaml", "  encroached:", "  encroach:", "clauses: encroach: no part of the rule give_way reads it"),
        ("speed.yaml", "  over_limit:", "  too_fast:", "clauses: over_limit: is missing"),
    ],
)  # fmt: skip
def test_a_file_that_does_not_fit_its_kind_is_refused(
    catalog_copy: Path, file: str, old: str, new: str, said: str
) -> None:
    path = catalog_copy / "rules" / file
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(InputError) as refusal:
        load_catalog(catalog_copy)
    assert str(refusal.value) == f"{path}: {said}"


def test_a_rule_that_nobody_declared_is_refused(catalog_copy: Path) -> None:
    text = (catalog_copy / "rules" / "speed.yaml").read_text(encoding="utf-8")
    (catalog_copy / "rules" / "fly.yaml").write_text(text.replace("rule: speed", "rule: fly"), encoding="utf-8")
    with pytest.raises(InputError, match=r"fly\.yaml: rule: 'fly' is not declared in tsbench/signs/rule_kinds\.py"):
        load_catalog(catalog_copy)
