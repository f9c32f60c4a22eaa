"""From a template to one file of HTML: styles, scripts and data inline, no network allowed by its own policy."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from collections.abc import Mapping, Sequence
from dataclasses import fields
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

import tsbench
from tsbench.report.drawing.style import ATTRIBUTION, STYLE

_PACKAGE = "tsbench.report.page"
BASE_SCRIPTS = ("core.js", "table.js", "bev.js")


@cache
def environment() -> Environment:
    """Templates, HTML with escaping on; a name that is not given is an error."""
    return Environment(
        loader=PackageLoader(_PACKAGE), autoescape=select_autoescape(["html"]), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip


def render_page(
    template: str,
    *,
    title: str,
    data: Mapping[str, Any] | None = None,
    blobs: Mapping[str, bytes] | None = None,
    scripts: Sequence[str] = (),
    served: bool = False,
    **context: Any,
) -> str:
    """A whole page. data, blobs: see the package; scripts: files of `static/` beside the base ones.

    served: the page may ask the server that it came from, and nobody else; otherwise it may ask nobody at all.
    """
    script = "\n".join(static_text(name) for name in (*BASE_SCRIPTS, *scripts))
    encoded = {name: b64encode(content).decode() for name, content in (blobs or {}).items()}
    return environment().get_template(template).render(
        title=title, data=dict(data or {}), blobs=encoded, style=Markup(static_text("base.css") + _bev_colours()),
        script=Markup(script), policy=_policy(script, served), version=tsbench.__version__, attribution=ATTRIBUTION,
        **context,
    )  # fmt: skip


@cache
def static_text(name: str) -> str:
    """A file of `static/`. Raises ValueError where it would end the element that it is put into."""
    text = files(_PACKAGE).joinpath("static", name).read_text(encoding="utf-8")
    if "</script" in text or "</style" in text:
        raise ValueError(f"{name}: holds the end of an element")
    return text


def _policy(script: str, served: bool) -> str:
    """Content security policy: only this very script runs."""
    digest = b64encode(hashlib.sha256(f"\n{script}\n".encode()).digest()).decode()
    parts = [
        "default-src 'none'", f"script-src 'sha256-{digest}'", "style-src 'unsafe-inline'", "img-src data:",
        "base-uri 'none'", "form-action 'none'",
    ]  # fmt: skip
    if served:
        parts.append("connect-src 'self'")
    return "; ".join(parts)


def _bev_colours() -> str:
    """The colours of bird's-eye pictures as CSS variables; `base.css` darkens some of them."""
    colours = {f.name: getattr(STYLE, f.name) for f in fields(STYLE)}
    named = {k: v for k, v in colours.items() if isinstance(v, tuple) and len(v) == 3}
    return ":root{" + "".join(f"--bev-{k}:rgb{v};" for k, v in named.items()).replace(" ", "") + "}"
