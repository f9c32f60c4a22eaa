"""The table of `make mutation`: of how many mutants of each file of the rules and of roads the tests take notice.

Reads what `mutmut results --all true` prints. A mutant is caught when a test fails, or when it runs on without end
(timeout). Exit code 1 where the share of all, or that of one file, is too small, or mutants were not tried.
"""

from __future__ import annotations

import sys
from collections import Counter, defaultdict
from collections.abc import Iterable

LEAST_SHARE = 0.90
# Of a single file: in a small one, a few mutants that change nothing weigh much.
LEAST_SHARE_OF_A_FILE = 0.75
CAUGHT = ("killed", "timeout")
UNTRIED = ("not checked", "check was interrupted by user")


def count(lines: Iterable[str]) -> dict[str, Counter[str]]:
    """By module, how many of its mutants came to which end. A line: `    <module>.<function>: <end>`."""
    ends: dict[str, Counter[str]] = defaultdict(Counter)
    for line in lines:
        mutant, colon, end = line.strip().rpartition(": ")
        if colon:
            ends[mutant.rpartition(".")[0]][end] += 1
    return dict(sorted(ends.items()))


def table(ends: dict[str, Counter[str]]) -> list[str]:
    """The table, a row per module and one for all."""
    rows = [f"{'file':32}{'mutants':>8}{'caught':>8}{'survived':>9}{'timeouts':>9}{'share':>8}"]
    total = sum(ends.values(), Counter[str]())
    for module, some in [*ends.items(), ("all", total)]:
        caught = sum(some[end] for end in CAUGHT)
        survived = some.total() - caught - sum(some[end] for end in UNTRIED)
        name = module if module == "all" else module.replace(".", "/") + ".py"
        rows.append(f"{name:32}{some.total():8}{caught:8}{survived:9}{some['timeout']:9}{caught / some.total():8.1%}")
    return rows


def faults(ends: dict[str, Counter[str]]) -> list[str]:
    """Why the run does not pass; empty where it does."""
    found = [] if ends else ["no mutants: run mutmut first"]
    groups = [(name, some, LEAST_SHARE_OF_A_FILE) for name, some in ends.items()]
    if ends:
        groups.append(("all", sum(ends.values(), Counter[str]()), LEAST_SHARE))
    for name, some, least in groups:
        untried = sum(some[end] for end in UNTRIED)
        share = sum(some[end] for end in CAUGHT) / some.total()
        if untried:
            found.append(f"{name}: {untried} mutants were not tried; run `make mutation` again to go on")
        elif share < least:
            found.append(f"{name}: {share:.1%} of the mutants are caught, less than {least:.0%}")
    return found


def main() -> int:
    """Print the table and what is wrong with it."""
    ends = count(sys.stdin)
    if ends:
        print("\n".join(table(ends)))
    wrong = faults(ends)
    print("\n".join(wrong), file=sys.stderr, end="\n" if wrong else "")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
