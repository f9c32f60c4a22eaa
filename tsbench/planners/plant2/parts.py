"""How many parameters stand where, beside what was published (docs/planners.md)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from tsbench.planners.plant2.network import Plant2FtNetwork, Plant2Network
from tsbench.planners.plant2.vocabulary import vocabulary_of

PUBLISHED_MEDIUM = 37_200_000
PUBLISHED_ADDED = 147_976


@dataclass(frozen=True, slots=True)
class Part:
    """A part of a network: its count, and the published one as it was written ("" where none was)."""

    name: str
    parameters: int
    published: str = ""


def parts(size: str) -> list[Part]:
    """Parts of `plant2` and of what `plant2-ft` adds, each with its sum."""
    words = vocabulary_of()
    base = _counts(Plant2Network(size))
    tuned = _counts(Plant2FtNetwork(size, len(words.codes)))
    of_medium = size == "medium"
    added = tuned.total() - base.total() - tuned["ways"]
    return [
        *(Part(name, count) for name, count in base.items()),
        Part("plant2", base.total(), "37.2 M" if of_medium else ""),
        *(Part(f"+ {name}", count) for name, count in tuned.items() if name not in base),
        Part("added by plant2-ft but ways", added, f"{PUBLISHED_ADDED:,}" if of_medium else ""),
    ]


def _counts(net: Plant2Network) -> Counter[str]:
    found: Counter[str] = Counter()
    for name, parameter in net.named_parameters():
        found[name.partition(".")[0]] += parameter.numel()
    return found
