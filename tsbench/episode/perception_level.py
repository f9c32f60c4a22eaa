"""How planners perceive plates, with the levels as data. Source: docs/perception.md."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsbench.core.errors import InputError
from tsbench.core.textfile import dataclass_from_json, read_yaml

EXACT = "exact"
PATH = Path(__file__).with_name("perception.yaml")


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
    right: float
    ceiling: float
    misread: float
    false_per_km: float
    latency_s: float
    half_px: float
    scale_px: float
    noise_m: float
    posts: bool
    values: tuple[tuple[float, ...], ...]
    codes: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        for name in ("right", "ceiling", "misread"):
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: {getattr(self, name)} is no share (0-1)")
        for name in ("false_per_km", "latency_s", "half_px", "noise_m"):
            if not 0.0 <= getattr(self, name) < 1e6:
                raise ValueError(f"{name}: {getattr(self, name)} is out of range")
        if not 0.0 < self.scale_px < 1e6:
            raise ValueError(f"scale_px: {self.scale_px} must be above 0")

    @property
    def told(self) -> float:
        """Share of plates that are ever read, right or as a neighbour."""
        return self.right + (1.0 - self.right) * self.misread


@dataclass(frozen=True)
class Perception:
    """How plates reach a planner in an episode. mask_signs: without code and value; level: None = exactly."""

    mask_signs: bool = False
    level: PerceptionLevel | None = None


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
        return dataclass_from_json(PerceptionLevel, {"name": name, **fields})
    except ValueError as error:
        raise InputError(f"{where}: perception level {name}: {error}") from None
