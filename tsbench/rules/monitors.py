"""Which monitor judges a rule: the one in the file of its name; and the monitors of a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

from tsbench.core.extras import import_all
from tsbench.rules.monitor import Monitor, Verdict, Violation
from tsbench.rules.needless_detour import NeedlessDetour
from tsbench.rules.needless_passage import NeedlessStop, NeedlessYield
from tsbench.rules.needless_slow import NeedlessSlow
from tsbench.rules.wrong_way import WrongWay
from tsbench.signs.annotations import SignInstance
from tsbench.signs.rule_kinds import RULE_KINDS, load_rule_classes
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot

MONITORS: Mapping[str, type[Monitor]] = load_rule_classes(
    import_all("tsbench.rules"),
    Monitor,  # type: ignore[type-abstract]
)


# By clause of a contrast scene; each takes the params of its kind (`signs.contrast.CLAUSES`).
NEEDLESS: Mapping[str, Callable[[Any, SignInstance, Scene], Monitor]] = MappingProxyType(
    {
        "needless_stop": NeedlessStop,
        "needless_yield": NeedlessYield,
        "needless_slow": NeedlessSlow,
        "needless_detour": NeedlessDetour,
    }
)


class NullMonitor(Monitor):
    """Of a contrast scene's plate that binds others: it never engages."""

    def step(self, snapshot: WorldSnapshot) -> None:
        """Nothing to see."""


def make_monitor(sign: SignInstance, scene: Scene) -> Monitor:
    """The monitor of a plate's rule. Only a contrast scene's plate may lack the params that its rule reads."""
    rule = scene.rule(sign)
    unbound = scene.contrast and not RULE_KINDS[rule.name].binds(sign.params)
    return (NullMonitor if unbound else MONITORS[rule.name])(sign, rule, scene)


class Verdicts(NamedTuple):
    """On the target, on the other signs, and what was obeyed needlessly and driven the wrong way, in order of time."""

    target: Verdict
    others: tuple[Verdict, ...]
    needless: tuple[Violation, ...]
    wrong_way: tuple[Violation, ...]


@dataclass(frozen=True)
class Monitors:
    """All that watch one episode: those of the target and of other plates, those of a contrast scene's clauses, and
    the one that watches in every scene.
    """

    target: Monitor
    others: tuple[Monitor, ...]
    needless: tuple[Monitor, ...]
    wrong_way: Monitor

    def update(self, snapshot: WorldSnapshot) -> None:
        """Take in one tick."""
        for monitor in (self.target, *self.others, *self.needless, self.wrong_way):
            monitor.update(snapshot)

    def finish(self) -> Verdicts:
        """What they say, once the episode is over."""
        events = [event for monitor in self.needless for event in monitor.finish().violations]
        return Verdicts(
            self.target.finish(),
            tuple(monitor.finish() for monitor in self.others),
            tuple(sorted(events, key=lambda event: (event.start_s, event.clause))),
            self.wrong_way.finish().violations,
        )


def make_monitors(scene: Scene) -> Monitors:
    """Those of the target, of the context plates that bind the ego, and of the scene's clauses.

    A context plate without params speaks to other traffic and is scenery. End plates belong to the plate that they
    end.
    """
    sign = scene.target_sign
    return Monitors(
        make_monitor(sign, scene),
        tuple(
            make_monitor(other, scene)
            for other in scene.signs
            if other.role == "context" and other.id != scene.target and other.params is not None
        ),
        tuple(NEEDLESS[clause.name](clause.params, sign, scene) for clause in scene.contrast),
        WrongWay(sign, scene),
    )
