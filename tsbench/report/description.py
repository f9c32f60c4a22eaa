"""Episodes and scenes in words: what captions, pages, recordings and `tsbench scenarios show` say of them."""

from __future__ import annotations

import re
from types import MappingProxyType

from tsbench.episode.trace import Trace
from tsbench.signs.countries import Country, shown_code, shown_value
from tsbench.sim.scene import Scene
from tsbench.sim.world import DT_S

_UNITS = MappingProxyType({"m/s2": "m/s²", "deg": "°"})


def sign_words(code: str, value: float | None, country: Country | None = None) -> str:
    return shown_code(code, country) + ("" if value is None else f" ({shown_value(value, country)})")


def unit_words(unit: str) -> str:
    """A unit of the catalogue as it is written in print."""
    return _UNITS.get(unit, unit)


def readable(sentence: str) -> str:
    """A sentence of the catalogue with such units, and no sign before a turn by nothing."""
    for unit, word in _UNITS.items():
        gap = r"\s" if word == "°" else ""
        sentence = re.sub(rf"(?<=\d){gap}{re.escape(unit)}\b|(?<=\d ){re.escape(unit)}\b", word, sentence)
    return re.sub(r"[+-]0°", "0°", sentence)


def episode_title(trace: Trace) -> str:
    """Planner and type; of a half of a pair the pair's type and which half."""
    spec = trace.spec
    half = f", {spec.half} half" if spec.pair_id else ""
    return f"{trace.planner}: {spec.pair_type}{half}"


def episode_subtitle(trace: Trace, country: Country | None = None) -> str:
    spec = trace.spec
    sign = sign_words(spec.sign_code, spec.sign_value, country)
    return f"{spec.scenario_id} · sign {sign} · {spec.group} · {spec.split}"


def scene_facts(scene: Scene, country: Country | None = None) -> dict[str, str]:
    """What stands in a scene, which ways lead through it, and for how long one may drive."""
    sign = scene.target_sign
    return {
        "sign": f"{sign_words(sign.code, sign.value, country)} on edge {sign.edge} at {sign.position_m:.0f} m",
        "plates": ", ".join(f"{shown_code(s.code, country)} ({s.role}) on {s.edge}" for s in scene.signs),
        "obstacles": ", ".join(f"{o.shape} on {o.lane}" for o in scene.obstacles) or "none",
        "convoy": f"{len(scene.convoy.vehicles)} vehicles" if scene.convoy else "none",
        "navigation": " > ".join(scene.route_hint),
        "obedient way": " > ".join(scene.compliant_hint) or "the same",
        "time": f"{scene.horizon * DT_S:.0f} s",
    }
