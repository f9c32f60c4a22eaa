"""docs/rules.md against the catalogue: both say the same, and neither says more."""

from __future__ import annotations

from collections import defaultdict

import pytest
from spec_tables import table, words

from tsbench.rules.monitors import MONITORS
from tsbench.signs.catalog import load_catalog

CATALOG = load_catalog()
CLAUSES = table("rules.md", "rule", "signs", "clauses")


def thresholds() -> dict[str, dict[str, float]]:
    """By rule, with what it takes over from the one that it extends."""
    own: dict[str, dict[str, float]] = defaultdict(dict)
    for row in table("rules.md", "rule", "threshold", "value"):
        for rule in words(row["rule"]):
            assert row["threshold"] not in own[rule], row
            own[rule][row["threshold"]] = float(row["value"])
    for rule, base in (("stop", "give_way"), ("roundabout", "give_way"), ("one_way_exit", "manoeuvre")):
        own[rule] = {**own[base], **own[rule]}
    return own


def test_every_rule_is_on_the_page() -> None:
    rules = {sign.rule.name for sign in CATALOG.signs.values()}
    assert set(thresholds()) == {row["rule"] for row in CLAUSES} == rules == set(MONITORS)


@pytest.mark.parametrize("code", sorted(CATALOG.signs))
def test_a_sign_has_the_thresholds_and_clauses_of_its_rule(code: str) -> None:
    rule = CATALOG.sign(code).rule
    assert dict(rule.thresholds) == thresholds()[rule.name]
    rows = [row for row in CLAUSES if code in words(row["signs"])]
    assert [row["rule"] for row in rows] == [rule.name]
    assert [clause.id for clause in rule.clauses] == words(rows[0]["clauses"])


def test_turns_allow_what_the_page_allows() -> None:
    page = {row["sign"]: words(row["allowed"]) for row in table("rules.md", "sign", "allowed")}
    catalogue = {
        code: list(sign.rule.options["allowed"])
        for code, sign in CATALOG.signs.items()
        if "allowed" in sign.rule.options
    }
    assert {code: sorted(turns) for code, turns in page.items()} == {
        code: sorted(turns) for code, turns in catalogue.items()
    }


def test_who_has_priority() -> None:
    page = {code: row["priority_to"] for row in table("rules.md", "priority_to") for code in words(row["signs"])}
    catalogue = {
        code: sign.rule.option("priority_to")
        for code, sign in CATALOG.signs.items()
        if "priority_to" in sign.rule.options
    }
    assert page == catalogue


@pytest.mark.parametrize(("name", "file"), [("needless", "contrast.md"), ("wrong_way", "rules.md")])
def test_what_is_needless_and_what_is_the_wrong_way(name: str, file: str) -> None:
    page = {row[name]: float(row["value"]) for row in table(file, name, "value")}
    assert page == dict(getattr(CATALOG, name).thresholds)
