"""How a page is divided: header, view, a strip of curves where a film has one, footer. Units: px."""

from __future__ import annotations

from dataclasses import dataclass

from tsbench.report.drawing.style import STYLE

_COMPACT_PX = 720


@dataclass(frozen=True, slots=True)
class PageSize:
    """A picture in px, header, strip and footer included. Video encoders want even numbers.

    strip_px: height of the curves of speed and acceleration under the view; 0 = none.
    """

    width: int
    height: int
    strip_px: int = 0

    @property
    def compact(self) -> bool:
        """Is it so narrow that clock and figures need lines of their own?"""
        return self.width < _COMPACT_PX

    @property
    def header_px(self) -> int:
        return STYLE.header_px

    @property
    def footer_px(self) -> int:
        return STYLE.compact_footer_px if self.compact else STYLE.footer_px

    @property
    def view_height(self) -> int:
        return self.height - self.header_px - self.strip_px - self.footer_px
