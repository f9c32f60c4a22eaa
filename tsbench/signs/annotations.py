"""One plate in a scene: the SUMO point of interest that stands for it, written and read without loss.

A plate is a `<poi type="sign">` of the scene's additional file, so that `sumo-gui` shows it as it is.
Everything that a monitor or a planner needs stands in its `<param>` children; floats are written with `repr`,
so a plate that is written and read again is equal to the one before.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from lxml import etree

from tsbench.core.errors import InputError
from tsbench.signs.catalog import Catalog
from tsbench.signs.contrast import CONTRAST
from tsbench.signs.rule_kinds import RULE_KINDS, Params, PlateParams, ZoneParams, read_params

ALL_LANES = -1
TARGET, DISTRACTOR = "target", "distractor"
ROLES = (TARGET, "end", "context", DISTRACTOR)

_COLORS = {"target": "red", "end": "grey", "context": "orange", DISTRACTOR: "orange"}
_LAYER = "100"
_RESERVED = frozenset({"code", "value", "edge", "lane", "position_m", "heading", "role", "ends", "temporary"})
_ANGLE_TOLERANCE_DEG = 0.01


@dataclass(frozen=True)
class SignInstance:
    """One plate in one scene.

    id: unique within the scene's additional file. value: the number that the sign sets, printed or implied, in its
    unit (km/h). edge, lane: whose traffic it addresses, the lane by SUMO's index (0 = at the kerb). position_m: where
    its line crosses the edge, metres from the start of its lanes. x, y: where the post stands, metres in the
    network's frame. heading: direction of travel of the traffic that it faces, rad, counter-clockwise from +x. role:
    "target" (the scene's watched sign), "end" (closes the target's zone), "context" (belongs to the target's scenes) or
    "distractor" (any plate, where it does not bind the ego). ends: id of the plate that it ends. params: what its kind
    of rule needs to know beside; None on a plate that binds nobody who is watched, and where the rule needs nothing.
    temporary: stands on yellow ground, as at road works (`overruled`).
    """

    id: str
    code: str
    value: float | None
    edge: str
    lane: int
    position_m: float
    x: float
    y: float
    heading: float
    role: str
    ends: str | None = None
    params: PlateParams | None = None
    temporary: bool = False

    def __post_init__(self) -> None:
        for name in ("value", "position_m", "x", "y", "heading"):
            number = getattr(self, name)
            if number is not None and not math.isfinite(number):
                raise ValueError(f"{name}: {number} is not a finite number")
        for name in ("id", "code", "edge"):
            if not getattr(self, name):
                raise ValueError(f"{name}: is empty")
        if self.lane < ALL_LANES:
            raise ValueError(f"lane: {self.lane} is below {ALL_LANES}")
        if self.position_m < 0:
            raise ValueError(f"position_m: {self.position_m} is negative")
        if self.role not in ROLES:
            raise ValueError(f"role: {self.role!r} is none of {', '.join(ROLES)}")

    @property
    def posted(self) -> float:
        """The number that the sign sets. Raises InputError where it has none."""
        if self.value is None:
            raise InputError(f"sign {self.id!r} ({self.code}): value is missing")
        return self.value

    def params_as(self, kind: type[Params]) -> Params:
        """The params, of the kind that a rule reads. Raises InputError where the plate carries none, or others."""
        if not isinstance(self.params, kind):
            raise InputError(f"sign {self.id!r} ({self.code}): carries no {kind.__name__}: {self.params}")
        return self.params


def overruled(plate: SignInstance, others: Iterable[SignInstance]) -> bool:
    """Is a permanent plate within the zone of a temporary one? Then the temporary one rules on, and the plate nothing.

    others: plates of the same rule. Source: PDD, Appendix 1: section 3 (yellow ground), last paragraph.
    """
    return not plate.temporary and any(
        other.temporary
        and isinstance(other.params, ZoneParams)
        and plate.edge in other.params.zone_edges
        and (plate.edge != other.edge or plate.position_m > other.position_m)
        for other in others
    )


def sumo_angle(heading: float) -> float:
    """SUMO's angle (degrees clockwise from north, 0 <= angle < 360) of a mathematical heading in rad."""
    angle = (90.0 - math.degrees(heading)) % 360.0
    return 0.0 if angle >= 360.0 else angle  # a tiny negative angle rounds up to 360 in the modulo


def sign_to_poi(sign: SignInstance) -> etree._Element:
    """The SUMO `<poi>` element of one plate.

    Its `angle` turns the plate's picture so that its top points the way the traffic it faces travels.
    """
    x, y, angle = (repr(float(number)) for number in (sign.x, sign.y, sumo_angle(sign.heading)))
    poi = etree.Element("poi", id=sign.id, type="sign", color=_COLORS[sign.role], layer=_LAYER, x=x, y=y, angle=angle)
    params = {
        "code": sign.code,
        "value": None if sign.value is None else repr(float(sign.value)),
        "edge": sign.edge,
        "lane": str(sign.lane),
        "position_m": repr(float(sign.position_m)),
        "heading": repr(float(sign.heading)),
        "role": sign.role,
        "ends": sign.ends,
        "temporary": "true" if sign.temporary else None,
    }
    ruled = {} if sign.params is None else sign.params.texts()
    for key, text in (*params.items(), *sorted(ruled.items())):
        if text is not None:
            etree.SubElement(poi, "param", {"key": key, "value": text})
    return poi


def signs_from_additional(root: etree._Element, catalog: Catalog, source: str) -> tuple[SignInstance, ...]:
    """All plates of a scene, in the order of the file; points of interest of other types are skipped.

    root: of the parsed additional file. source: its name for error messages. The target of a contrast scene may be a
    plate that binds nobody who is watched: it needs no params. Raises InputError: a plate lacks a param, has one that
    does not parse or that contradicts another, an id occurs twice, or a plate ends one that is not there.
    """
    signs: dict[str, SignInstance] = {}
    contrast = root.find(f"poi[@type='{CONTRAST}']") is not None
    for poi in root.iterfind("poi"):
        if poi.get("type") != "sign":
            continue
        sign = _sign_from_poi(poi, catalog, source, contrast)
        if sign.id in signs:
            raise InputError(f"{source}: sign {sign.id!r}: the id occurs twice")
        signs[sign.id] = sign
    for sign in signs.values():
        if sign.ends is not None and sign.ends not in signs:
            raise InputError(f"{source}: sign {sign.id!r}: ends {sign.ends!r}, which is not in the scene")
    return tuple(signs.values())


def _sign_from_poi(poi: etree._Element, catalog: Catalog, source: str, contrast: bool) -> SignInstance:
    where = f"{source}: sign {poi.get('id', '')!r}"
    given: dict[str, str] = {}
    for param in poi.iterfind("param"):
        key = param.get("key")
        if key is None or key in given:
            raise InputError(f"{where}: a param has {'no key' if key is None else f'key {key!r} twice'}")
        given[key] = param.get("value", "")
    extra = {key: text for key, text in given.items() if key not in _RESERVED}
    try:
        rule = catalog.sign(given["code"]).rule.name
        if given.get("temporary", "true") != "true":
            raise ValueError(f"temporary: {given['temporary']!r} is not true")
        sign = SignInstance(
            id=poi.get("id", ""),
            code=given["code"],
            value=float(given["value"]) if "value" in given else None,
            edge=given["edge"],
            lane=int(given["lane"]),
            position_m=float(given["position_m"]),
            x=float(poi.attrib["x"]),
            y=float(poi.attrib["y"]),
            heading=float(given["heading"]),
            role=given["role"],
            ends=given.get("ends"),
            params=plate_params(rule, extra, binds=given["role"] == "target" and not contrast),
            temporary="temporary" in given,
        )
        angle = float(poi.attrib["angle"])
    except KeyError as error:
        raise InputError(f"{where}: {error.args[0]} is missing") from error
    except (InputError, ValueError) as error:
        raise InputError(f"{where}: {error}") from error
    turned = (angle - sumo_angle(sign.heading) + 180.0) % 360.0 - 180.0
    if not abs(turned) <= _ANGLE_TOLERANCE_DEG:
        raise InputError(f"{where}: angle {angle} contradicts its heading of {sign.heading} rad")
    return sign


def plate_params(rule: str, given: Mapping[str, str], *, binds: bool = True) -> PlateParams | None:
    """The params of a plate from their texts; only one that surely `binds` the ego must have any.

    rule: the name of its sign's. Raises ValueError for a missing or strange one.
    """
    kind = RULE_KINDS[rule].params
    if not given and (kind is None or not binds):
        return None
    if kind is None:
        raise ValueError(f"param {min(given)!r}: rule {rule} knows none")
    try:
        return read_params(kind, given)
    except ValueError as error:
        raise ValueError(f"{error} (rule {rule})") from None
