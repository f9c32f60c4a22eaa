"""Which monitor judges a rule: the one in the file of its name; and the monitors of a scene."""

from __future__ import annotations

from collections.abc import Mapping

from tsbench.core.modules import import_all
from tsbench.rules.base import Monitor
from tsbench.rules.needless import ContrastTarget
from tsbench.signs.annotations import SignInstance
from tsbench.signs.catalog import Catalog
from tsbench.signs.rule_kinds import RULE_KINDS, class_of_every_kind
from tsbench.sim.scene import Scene
from tsbench.sim.world import WorldSnapshot

MONITORS: Mapping[str, type[Monitor]] = class_of_every_kind(
    import_all("tsbench.rules"),
    Monitor,  # type: ignore[type-abstract]
)


class Unbound(Monitor):
    """Of a contrast scene's plate that binds others: it never engages."""

    def step(self, snapshot: WorldSnapshot) -> None:
        """Nothing to see."""


def make_monitor(sign: SignInstance, catalog: Catalog, scene: Scene) -> Monitor:
    """The monitor of a plate's rule. Only a contrast scene's plate may lack the params that its rule reads."""
    rule = catalog.sign(sign.code).rule
    unbound = scene.contrast and not RULE_KINDS[rule.name].binds(sign.params)
    return (Unbound if unbound else MONITORS[rule.name])(sign, rule, scene)


def make_monitors(catalog: Catalog, scene: Scene) -> tuple[Monitor, tuple[Monitor, ...]]:
    """The target's monitor, and those of the context plates that bind the ego.

    A context plate without params speaks to other traffic and is scenery. End plates belong to the plate that they
    end.
    """
    others = tuple(
        make_monitor(sign, catalog, scene)
        for sign in scene.signs
        if sign.role == "context" and sign.id != scene.target and sign.params is not None
    )
    target = make_monitor(scene.target_sign, catalog, scene)
    return ContrastTarget(target, catalog) if scene.contrast else target, others
