"""A stored scene in the mirror x -> -x: where traffic kept to the right it keeps to the left.

Lanes, connections and right of way go by number in SUMO, the lane at the kerb first: in a network that says
`lefthand="true"` the same numbers hold on the other side, so only coordinates, angles, turns and plates change.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from lxml import etree

from tsbench.core.xmlfile import parse
from tsbench.geometry.elementary import wrap
from tsbench.scenarios.spec import ScenarioSpec
from tsbench.signs.annotations import sumo_angle
from tsbench.signs.catalog import Catalog, mirrored_code, mirrored_slot
from tsbench.signs.model import Sign
from tsbench.sim.scene import SceneFile

_SHAPES = ("shape", "outlineShape", "customShape")
_BOUNDS = ("convBoundary", "origBoundary")
_TURNS = MappingProxyType({"l": "r", "r": "l", "L": "R", "R": "L", "t": "T", "T": "t"})
_RIGHT_OF_WAY = MappingProxyType({"right_before_left": "left_before_right", "left_before_right": "right_before_left"})


def mirrored_row(spec: ScenarioSpec, catalog: Catalog) -> ScenarioSpec:
    """The row of a scene's mirror image. Its files and their hashes are those that it is made of."""
    kind, pair = catalog.mirrored_type(spec.scenario_type), mirrored_id(spec.pair_id, catalog)
    return replace(
        spec,
        scenario_id=mirrored_id(spec.scenario_id, catalog),
        scenario_type=kind,
        pair_id=pair,
        sign_code=mirrored_code(catalog.signs, spec.sign_code),
        slot=mirrored_slot(spec.slot),
    )


def mirrored_id(name: str, catalog: Catalog) -> str:
    """The id of a row's or pair's mirror image; it begins with its type."""
    kind, dash, rest = name.partition("-")
    return f"{catalog.mirrored_type(kind)}{dash}{rest}" if name else name


def mirrored_network(file: SceneFile) -> SceneFile:
    """A network file in the mirror."""
    root = parse(file.content, file.path, "net", "network")
    root.set("lefthand", "true")
    for element in root.iter("location", "edge", "lane", "junction", "connection"):
        _mirror_place(element)
        for key in _BOUNDS:
            if key in element.attrib:
                west, south, east, north = str(element.attrib[key]).split(",")
                element.set(key, ",".join((_negative(east), south, _negative(west), north)))
        if element.tag == "connection":
            element.set("dir", _TURNS.get(element.get("dir", "s"), element.get("dir", "s")))
        if element.tag == "junction":
            element.set("type", _RIGHT_OF_WAY.get(element.get("type", ""), element.get("type", "")))
    return SceneFile(file.path, etree.tostring(root))


def mirrored_additional(file: SceneFile, signs: Mapping[str, Sign]) -> SceneFile:
    """An additional file in the mirror, its plates turned into their images."""
    root = parse(file.content, file.path, "additional", "scene file")
    for element in root.iter("poi", "poly"):
        _mirror_place(element)
        params = {str(p.get("key")): p for p in element.iterfind("param")}
        _mirror_params(params, signs)
        if "angle" in element.attrib:
            element.set("angle", repr(sumo_angle(float(params["heading"].attrib["value"]))))
    for walk in root.iter("walk"):
        # Unlike a vehicle's, SUMO counts a walker's offset to the left everywhere.
        walk.set("departPosLat", _negative(str(walk.attrib["departPosLat"])))
    return SceneFile(file.path, etree.tostring(root))


def _mirror_params(params: Mapping[str, etree._Element], signs: Mapping[str, Sign]) -> None:
    for key, param in params.items():
        value = str(param.attrib["value"])
        if key == "heading":
            param.set("value", repr(wrap(math.pi - float(value))))
        elif key == "x":
            param.set("value", _negative(value))
        elif key == "code":
            param.set("value", mirrored_code(signs, value))


def _mirror_place(element: etree._Element) -> None:
    if "x" in element.attrib:
        element.set("x", _negative(str(element.attrib["x"])))
    for key in _SHAPES:
        if key in element.attrib:
            points = (point.partition(",") for point in str(element.attrib[key]).split())
            element.set(key, " ".join(f"{_negative(x)},{rest}" for x, _, rest in points))


def _negative(number: str) -> str:
    """A number's text with the other sign: no digit is lost."""
    return number[1:] if number.startswith("-") else f"-{number}"
