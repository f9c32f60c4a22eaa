"""How planners perceive plates, with the levels as data. Source: docs/perception.md."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from tsbench.core.errors import InputError
from tsbench.core.textfile import read_yaml
from tsbench.core.typed import typed

EXACT = "exact"
PATH = Path(__file__).with_name("perception.yaml")
_Share = Annotated[float, Meta(ge=0.0, le=1.0)]
_Measure = Annotated[float, Meta(ge=0.0, lt=1e6)]


@dataclass(frozen=True)
class PerceptionLevel:
    """One level; nothing of it is drawn. Shares lie in 0-1.

    right: share of plates that are ever read right. misread: of the others, share read as a neighbour. ceiling: recall
    of one look at a plate however large. half_px, scale_px: apparent size at which half of what is ever read is read,
    and the width of that logistic curve. latency_s: from the look that reads to the planner. noise_m: bound of the
    error along the road. false_per_km: plates that are not there, per km driven. posts: is a plate in sight that is
    not read seen as a post? values, codes: lines of neighbours.
    """

    name: str
    right: _Share
    ceiling: _Share
    misread: _Share
    false_per_km: _Measure
    latency_s: _Measure
    half_px: _Measure
    scale_px: Annotated[float, Meta(gt=0.0, lt=1e6)]
    noise_m: _Measure
    posts: bool
    values: tuple[tuple[float, ...], ...]
    codes: tuple[tuple[str, ...], ...]

    @property
    def told(self) -> float:
        """Share of plates that are ever read, right or as a neighbour."""
        return self.right + (1.0 - self.right) * self.misread


@dataclass(frozen=True)
class Perception:
    """How plates reach a planner in an episode. masked: without code and value; level: None = exactly."""

    masked: bool = False
    level: PerceptionLevel | None = None

    @property
    def name(self) -> str:
        """The level's."""
        return EXACT if self.level is None else self.level.name


EXACTLY = Perception()


def load_level(given: str) -> PerceptionLevel | None:
    """The level of that name, or of a YAML file with a level's fields; None for `exact`.

    What a file does not say of neighbours and looks is as in the levels of the package. Raises InputError.
    """
    if given == EXACT:
        return None
    packaged = read_yaml(PATH, "perception levels")
    if given in packaged["levels"]:
        return _level(given, packaged["levels"][given], str(PATH))
    path = Path(given)
    if path.suffix not in (".yaml", ".yml"):
        names = ", ".join((EXACT, *packaged["levels"]))
        raise InputError(f"--perception {given}: expected {names}, or a .yaml file")
    told = read_yaml(path, "a perception level")
    if not isinstance(told, dict):
        raise InputError(f"{path}: a perception level is a mapping of its fields")
    return _level(path.stem, {**packaged["neighbours"], **packaged["looks"], **told}, str(path))


def _level(name: str, fields: Mapping[str, Any], where: str) -> PerceptionLevel:
    try:
        return typed(PerceptionLevel, {"name": name, **fields})
    except ValueError as error:
        raise InputError(f"{where}: perception level {name}: {error}") from None
