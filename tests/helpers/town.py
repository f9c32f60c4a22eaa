"""A small town made up for the tests: a grid of streets, a roundabout, long roads, a fork, a signal."""

from __future__ import annotations

import math

from tsbench.make.maps.utm import UtmFrame

EAST, NORTH = 410_000.0, 6_180_000.0


class Town:
    """Collects nodes and ways in metres and writes them as OSM XML."""

    def __init__(self) -> None:
        self.nodes: dict[tuple[float, float], int] = {}
        self.tagged: dict[int, str] = {}
        self.ways: list[tuple[list[int], dict[str, str]]] = []

    def node(self, x: float, y: float) -> int:
        return self.nodes.setdefault((round(x, 2), round(y, 2)), 1001 + len(self.nodes))

    def road(self, points: list[tuple[float, float]], highway: str, **tags: str) -> None:
        self.ways.append(([self.node(*point) for point in points], {"highway": highway, **tags}))

    def xml(self, frame: UtmFrame = UtmFrame(37), north: float = NORTH) -> str:  # noqa: B008
        """As OSM XML, anywhere: the same metres in another zone, or at another northing."""
        lines = ['<?xml version="1.0" encoding="UTF-8"?>', '<osm version="0.6">']
        for (x, y), number in self.nodes.items():
            lat, lon = frame.to_degrees(EAST + x, north + y).tolist()
            tag = f'<tag k="highway" v="{self.tagged[number]}"/>' if number in self.tagged else ""
            lines.append(f'<node id="{number}" version="1" lat="{lat:.7f}" lon="{lon:.7f}">{tag}</node>')
        for number, (refs, tags) in enumerate(self.ways, start=501):
            inner = "".join(f'<nd ref="{ref}"/>' for ref in refs)
            inner += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
            lines.append(f'<way id="{number}" version="1">{inner}</way>')
        return "\n".join([*lines, "</osm>\n"])


def make_town() -> Town:
    """5 x 4 streets (interior crossings X, border ones T), one signal, and single roads to the south."""
    town = Town()
    xs, ys = [150.0 * i for i in range(5)], [130.0 * j for j in range(4)]
    for y in ys:
        town.road([(x, y) for x in xs], "residential")
    for x in xs:
        town.road([(x, y) for y in ys], "tertiary", lanes="2")
    town.tagged[town.node(150, 130)] = "traffic_signals"
    ring = [(300 + 20 * math.cos(a), -400 + 20 * math.sin(a)) for a in (math.radians(15 * i) for i in range(24))]
    town.road([*ring, ring[0]], "tertiary", junction="roundabout", oneway="yes", lanes="1")
    for k in range(4):
        cx, cy = ring[6 * k]
        dx, dy = (cx - 300) / 20, (cy + 400) / 20
        town.road([(cx, cy), (cx + 150 * dx, cy + 150 * dy)], "tertiary", lanes="2")
    town.road([(0, -900), (400, -900)], "secondary", lanes="4")
    town.road([(0, -1000), (300, -1000)], "primary", oneway="yes", lanes="3")
    bend = [(250 * math.sin(a), -1400 + 250 * (1 - math.cos(a))) for a in (0.04 * i for i in range(25))]
    town.road(bend, "secondary", lanes="2")
    town.road([(0, -1700), (100, -1700), (220, -1700)], "residential")
    town.road([(100, -1700), (210, -1670)], "residential")  # a fork: arms 15 degrees apart
    return town
