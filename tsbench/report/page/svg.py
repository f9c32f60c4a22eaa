"""Matplotlib figures as inline SVG that takes the colours of the page, light or dark."""

from __future__ import annotations

import io
import re
from collections.abc import Callable

import matplotlib as mpl
from lxml import etree
from markupsafe import Markup
from matplotlib.figure import Figure

from tsbench.report.tables.charts import GREY, GROUP_COLOURS, INK, PALE, house_style

_SVG = "{http://www.w3.org/2000/svg}"
_LINK = "{http://www.w3.org/1999/xlink}href"
# What a figure's colour becomes; CSS variables of base.css.
_COLOURS = {
    INK: "currentColor", "#000000": "currentColor", GREY: "var(--faint)", PALE: "var(--line)",
    "#e4e4e4": "var(--grid)", "#ffffff": "var(--card)",
    **{colour: f"var(--group-{group})" for group, colour in GROUP_COLOURS.items()},
}  # fmt: skip
_COLOUR = re.compile("|".join(_COLOURS))


def inline_svg(draw: Callable[[], Figure], name: str, label: str) -> Markup:
    """name: before its ids, so that those of several figures differ; label: what those hear who do not see it."""
    file = io.BytesIO()
    with house_style():
        mpl.rcParams["svg.fonttype"] = "none"
        draw().savefig(file, format="svg", transparent=True, metadata={"Creator": None, "Date": None})
    root = etree.fromstring(file.getvalue(), etree.XMLParser(resolve_entities=False, no_network=True))
    for element in root.iter():
        _adapt(element, name)
    for style in list(root.iter(f"{_SVG}style", f"{_SVG}metadata")):
        parent = style.getparent()
        if parent is not None:
            parent.remove(style)
    root.set("role", "img")
    root.set("aria-label", label)
    return Markup(etree.tostring(root, encoding="unicode", with_tail=False))


def _adapt(element: etree._Element, name: str) -> None:
    attributes = element.attrib
    if "id" in attributes:
        attributes["id"] = f"{name}-{attributes['id']!s}"
    if _LINK in attributes:
        attributes[_LINK] = str(attributes[_LINK]).replace("#", f"#{name}-")
    for key in ("clip-path", "style", "fill", "stroke"):
        if key in attributes:
            text = str(attributes[key]).replace("url(#", f"url(#{name}-")
            attributes[key] = _COLOUR.sub(lambda found: _COLOURS[found.group()], text)
