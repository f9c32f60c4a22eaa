"""What adds up over an episode: a stay that is broken off does not begin the count anew."""

from __future__ import annotations

from tsbench.rules.events import Excursion
from tsbench.sim.world import WorldSnapshot

_LEAST_EXCESS = 1e-6


class InAll:
    """The excursions of one clause that hold longer (or farther) than `most` in all.

    One begins with its first tick, and becomes an event once the whole is too much: its value.
    """

    def __init__(self, excursion: Excursion, most: float) -> None:
        self._excursion, self._most = excursion, most
        self._whole = 0.0
        self._ticks: list[WorldSnapshot] = []

    @property
    def open(self) -> bool:
        """Is an excursion that is an event under way?"""
        return self._excursion.open

    def add(self, snapshot: WorldSnapshot, amount: float, is_told: bool = False) -> None:
        """The clause is broken at this tick. amount: of time or way. is_told: by another event, so by none of these."""
        self._whole += amount
        if is_told:
            self._ticks.clear()
            return
        self._ticks.append(snapshot)
        if self._whole > self._most + _LEAST_EXCESS:
            for tick in self._ticks:
                self._excursion.broken(tick, self._whole, self._most)
            self._ticks.clear()

    def keep(self) -> None:
        """It is kept at this tick."""
        self._ticks.clear()
        self._excursion.close()
