"""A picture of who imports whom in tsbench (`make picture`)."""

from __future__ import annotations

from import_graph import LAYER, LAYERS, ROOT, imports, package_of

PICTURE = ROOT.parent / "docs" / "images" / "architecture.svg"

_WINGS = {
    "bench: asks, shows": ("#e6defa", {"cli", "api", "report"}),
    "bench: drives, judges": ("#cfe2ff", {"run", "metrics", "episode", "planners", "rules", "scenarios", "sim"}),
    "workshops": ("#ffe2b8", {"make", "learn", "board", "bridges"}),
    "what all stand on": ("#e9ecef", {"roads", "signs", "geometry", "core"}),
}
_COLUMN, _ROW, _BOX_W, _BOX_H, _LEFT, _TOP = 150, 62, 112, 30, 40, 18


def package_imports() -> dict[str, set[str]]:
    """By package those that it imports."""
    found: dict[str, set[str]] = {package: set() for package in LAYER}
    for module, names in imports().items():
        for name in names:
            if package_of(module) and package_of(name) not in ("", package_of(module)):
                found[package_of(module)].add(package_of(name))
    return found


def arrows() -> list[tuple[str, str]]:
    """Imports between packages that no longer path implies, in order: few enough to be drawn."""
    graph = package_imports()

    def below(start: str, but: str) -> set[str]:
        seen: set[str] = set()
        todo = [name for name in graph[start] if name != but]
        while todo:
            name = todo.pop()
            if name not in seen:
                seen.add(name)
                todo += graph[name]
        return seen

    return [(a, b) for a in LAYER for b in sorted(graph[a]) if b not in below(a, b)]


def draw() -> str:
    """The layers with these arrows, as SVG."""
    place = {
        name: (_LEFT + column * _COLUMN + _BOX_W / 2, _TOP + row * _ROW)
        for row, layer in enumerate(LAYERS)
        for name, column in layer.items()
    }
    width, height = _LEFT + 4 * _COLUMN + _BOX_W, 2 * _TOP + (len(LAYERS) - 1) * _ROW + _BOX_H
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="DejaVu Sans, Verdana, sans-serif" font-size="13">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
        '<path d="M0 0 L8 4 L0 8 z" fill="#495057"/></marker></defs>',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
    ]
    for row in range(len(LAYERS)):
        y = _TOP + row * _ROW
        if row % 2 == 0:
            parts.append(f'<rect y="{y - 16}" width="{width}" height="{_ROW}" fill="#f8f9fa"/>')
        parts.append(f'<text x="12" y="{y + 20}" fill="#868e96" font-size="11">{row + 1}</text>')
    parts += [_arrow(place[a], place[b]) for a, b in arrows()]
    for name, (x, y) in place.items():
        colour = next(colour for colour, members in _WINGS.values() if name in members)
        parts.append(
            f'<rect x="{x - _BOX_W / 2:g}" y="{y}" width="{_BOX_W}" height="{_BOX_H}" rx="6" fill="{colour}" '
            f'stroke="#495057"/><text x="{x:g}" y="{y + 20}" text-anchor="middle">{name}</text>'
        )
    for number, (words, (colour, _)) in enumerate(_WINGS.items()):
        y = _TOP + 4 * _ROW + 20 * number
        parts.append(
            f'<rect x="{width - 190}" y="{y:g}" width="14" height="14" rx="3" fill="{colour}" stroke="#495057"/>'
            f'<text x="{width - 170}" y="{y + 12:g}" font-size="12">{words}</text>'
        )
    return "\n".join([*parts, "</svg>\n"])


def _arrow(start: tuple[float, float], end: tuple[float, float]) -> str:
    (ax, ay), (bx, by) = start, end
    if ay == by:
        side = _BOX_W / 2 if bx > ax else -_BOX_W / 2
        line = f"M{ax + side:g} {ay + _BOX_H / 2:g} L{bx - side:g} {by + _BOX_H / 2:g}"
    elif by - ay > _ROW and abs(ax - bx) > _COLUMN:
        side = _BOX_W / 2 if ax > bx else -_BOX_W / 2
        line = f"M{ax:g} {ay + _BOX_H:g} Q{ax:g} {by + _BOX_H / 2:g} {bx + side:g} {by + _BOX_H / 2:g}"
    else:
        lean = max(min(0.3 * (ax - bx), 0.4 * _BOX_W), -0.4 * _BOX_W)
        line = f"M{ax - lean:g} {ay + _BOX_H:g} L{bx + lean:g} {by:g}"
    return f'<path d="{line}" fill="none" stroke="#495057" stroke-width="1.3" marker-end="url(#tip)"/>'


if __name__ == "__main__":
    PICTURE.write_text(draw(), encoding="utf-8")
