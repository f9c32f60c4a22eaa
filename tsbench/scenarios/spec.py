"""The scenario row: the frozen description of one episode, as it stands in `scenarios/<split>.parquet`."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from tsbench.signs.model import COMBINED

SCHEMA_VERSION = 1
SIGNED, CONTRAST = "signed", "contrast"
HALVES = (SIGNED, CONTRAST)
MOST_TICKS = 10_000
# Behind the id of a square's first pair, the id of its second one.
SECOND_PAIR = "b"
_ROWS = {
    (False, SIGNED): "both signs",
    (False, CONTRAST): "the first sign's contrast plate",
    (True, SIGNED): "the last sign's contrast plate",
    (True, CONTRAST): "both contrast plates",
}


def pair_type(pair_id: str, scenario_type: str) -> str:
    """The type of a row's pair: that of its signed row, which is in the pair's id. "" = no pair: the row's own."""
    return pair_id.partition("-")[0] or scenario_type


def square_of(pair_id: str) -> str:
    """What a pair's rows are taken with: of a scenario with two signs the id of its first pair, else the pair's own.

    The halves of either pair differ in the first sign, the pairs in the last one.
    """
    return pair_id.removesuffix(SECOND_PAIR)


@dataclass(frozen=True, slots=True)
class ScenarioSpec:
    """One row. Identity, the axes that vary, where the scene files are, and their hashes.

    net, additional: paths relative to the `scenarios/` folder. net_sha256, additional_sha256: of the uncompressed
    content. initial_speed: m/s. route_length: m from decision point to destination (NaN = the map's natural length).
    density: asked moving cars per lane within 150 m (0 = none). drivers: the background-driver draw, -1 = none.
    layout: number on the scene's own layout axis. pair_id: of both rows of a contrast pair the signed one's id, "" = no
    pair. half: SIGNED or CONTRAST; a contrast row's type, group and sign are those of its own plate. place: id that the
    map shares with all maps of its place, "" = not known; figures of one place are correlated.
    """

    scenario_id: str
    scenario_type: str
    group: str
    sign_code: str
    sign_value: float | None
    map_id: str
    family: str
    shape: str
    slot: str
    variant: int
    split: str
    seed: int
    initial_speed: float
    route_length: float
    density: float
    drivers: int
    layout: int
    horizon: int
    net: str
    additional: str
    net_sha256: str
    additional_sha256: str
    pair_id: str = ""
    half: str = SIGNED
    place: str = ""

    @property
    def pair_type(self) -> str:
        """The type of the pair: its signed row's. It selects both halves, and names the store of their files."""
        return pair_type(self.pair_id, self.scenario_type)

    @property
    def pair_name(self) -> str:
        """What is taken whole: the id of the square or the pair, or the row's own where there is neither."""
        return square_of(self.pair_id) or self.scenario_id

    @property
    def which(self) -> str:
        """Which half of its pair it is, of a square which plates it has; "" without a pair."""
        if self.group == COMBINED:
            return _ROWS[self.pair_id.endswith(SECOND_PAIR), self.half]
        return f"{self.half} half" if self.pair_id else ""


def other_halves(rows: Iterable[ScenarioSpec]) -> dict[str, ScenarioSpec]:
    """By scenario the row of the other half of its pair, of those whose both halves are there."""
    pairs: dict[str, list[ScenarioSpec]] = {}
    for row in rows:
        if row.pair_id:
            pairs.setdefault(row.pair_id, []).append(row)
    whole = [pair for pair in pairs.values() if len(pair) == len(HALVES)]
    return {row.scenario_id: other for pair in whole for row, other in zip(pair, reversed(pair), strict=True)}
