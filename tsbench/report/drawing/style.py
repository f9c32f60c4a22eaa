"""Colours (RGB) and sizes of pictures, in one place: m where on the road, px where on the page."""

from __future__ import annotations

from dataclasses import dataclass

Colour = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Style:
    ground: Colour = (229, 232, 223)
    green: Colour = (214, 226, 203)
    water: Colour = (204, 218, 230)
    building: Colour = (215, 213, 206)
    walk: Colour = (206, 205, 199)
    asphalt: Colour = (86, 91, 99)
    kerb: Colour = (150, 154, 160)
    reserved: Colour = (104, 96, 84)
    marking: Colour = (246, 246, 242)
    ego: Colour = (255, 112, 32)
    trail: Colour = (255, 168, 96)
    car: Colour = (160, 200, 235)
    bus: Colour = (245, 200, 80)
    bicycle: Colour = (120, 214, 140)
    pedestrian: Colour = (250, 110, 170)
    convoy: Colour = (203, 160, 250)
    glass: Colour = (38, 44, 54)
    outline: Colour = (30, 33, 38)
    route: Colour = (70, 170, 255)
    plan: Colour = (214, 92, 214)
    compliant: Colour = (60, 200, 120)
    destination: Colour = (46, 178, 98)
    plate_line: Colour = (255, 196, 0)
    violation: Colour = (228, 30, 45)
    cone: Colour = (255, 120, 20)
    lamp: Colour = (255, 190, 40)
    brake: Colour = (255, 40, 40)
    island: Colour = (214, 212, 200)
    panel: Colour = (28, 32, 38)
    ink: Colour = (240, 242, 245)
    faint: Colour = (150, 158, 168)
    marking_m: float = 0.15
    stop_line_m: float = 0.4
    dash_m: tuple[float, float] = (3.0, 4.5)
    header_px: int = 64
    footer_px: int = 56
    compact_footer_px: int = 72


STYLE = Style()
VIOLATION_SHADE = 0.62  # of the violation's colour behind white text
ATTRIBUTION = "© OpenStreetMap contributors"
