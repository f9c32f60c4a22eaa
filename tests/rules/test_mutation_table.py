from __future__ import annotations

from mutation_table import count, faults, table


def _results(killed: int, survived: int, timeout: int = 0, untried: int = 0) -> list[str]:
    ends = ["killed"] * killed + ["survived"] * survived + ["timeout"] * timeout + ["not checked"] * untried
    return [f"    tsbench.rules.stop.xǁStopǁstep__mutmut_{k}: {end}" for k, end in enumerate(ends)]


def test_mutants_are_counted_by_file() -> None:
    other = "    tsbench.rules.zone.x_posted_kmh__mutmut_1: no tests"
    head, stop, zone, total = table(count([*_results(16, 3, 1), other, ""]))
    assert head.split() == ["file", "mutants", "caught", "survived", "timeouts", "share"]
    assert stop.split() == ["tsbench/rules/stop.py", "20", "17", "3", "1", "85.0%"]
    assert zone.split() == ["tsbench/rules/zone.py", "1", "0", "1", "0", "0.0%"]
    assert total.split() == ["all", "21", "17", "4", "1", "81.0%"]


def test_too_few_caught_and_untried_mutants_are_faults() -> None:
    assert faults(count(_results(18, 2))) == []
    assert faults(count(_results(17, 2, 1))) == []
    assert faults(count(_results(89, 11))) == ["all: 89.0% of the mutants are caught, less than 90%"]
    assert "2 mutants were not tried" in faults(count(_results(20, 0, untried=2)))[0]
    assert faults(count([])) == ["no mutants: run mutmut first"]


def test_a_file_may_fall_behind_by_a_little_only() -> None:
    zone = ["    tsbench.rules.zone.x_posted_kmh__mutmut_1: killed"] * 3
    missed = "    tsbench.rules.zone.x_posted_kmh__mutmut_2: survived"
    assert faults(count([*_results(40, 0), *zone, missed])) == []
    assert faults(count([*_results(40, 0), *zone, missed, missed])) == [
        "tsbench.rules.zone: 60.0% of the mutants are caught, less than 75%"
    ]
