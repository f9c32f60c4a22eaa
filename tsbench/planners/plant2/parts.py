"""How many parameters stand where, beside what was published (docs/spec/planners.md)."""

from __future__ import annotations

from dataclasses import dataclass

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
    from tsbench.planners.plant2.network import Plant2Network
    from tsbench.planners.plant2.network_ft import Plant2FtNetwork

    counts = {name: _counts(kind(size)) for name, kind in (("", Plant2Network), ("ft", Plant2FtNetwork))}
    base, tuned = counts[""], counts["ft"]
    of_medium = size == "medium"
    rows = [Part(name, count) for name, count in base.items()]
    rows.append(Part("plant2", sum(base.values()), "37.2 M" if of_medium else ""))
    rows += [Part(f"+ {name}", count) for name, count in tuned.items() if name not in base]
    added = sum(tuned.values()) - sum(base.values()) - tuned["ways"]
    rows.append(Part("added by plant2-ft but ways", added, f"{PUBLISHED_ADDED:,}" if of_medium else ""))
    return rows


def _counts(net: object) -> dict[str, int]:
    from torch import nn

    assert isinstance(net, nn.Module)
    found: dict[str, int] = {}
    for name, parameter in net.named_parameters():
        part = name.partition(".")[0]
        found[part] = found.get(part, 0) + parameter.numel()
    return found
