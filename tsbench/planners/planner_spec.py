"""What stands behind `--planner`, taken apart; nothing is imported for it."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from tsbench.core.errors import InputError

EXPERT: Final = "-e"
EXECUTABLE: Final = "exe:"
NUPLAN: Final = "nuplan:"
_IMAGE: Final = "image:"


@dataclass(frozen=True, slots=True)
class PlannerSpec:
    """A planner's specification.

    text: what is driven: a registered name, `pkg.module:Class`, `file.py:Class`, `nuplan:...` or `exe:FILE`, with `-e`
        behind it for its expert.
    image: of the container that it is driven in, None without one.
    """

    text: str
    image: str | None = None

    @classmethod
    def parse(cls, written: str) -> PlannerSpec:
        """The specification as a user or a run writes it. Raises InputError for an image that is an engine's option."""
        if not written.startswith(_IMAGE):
            return cls(written)
        image, _, text = written.removeprefix(_IMAGE).partition(" ")
        if not image or image.startswith("-"):
            raise InputError(f"planner {written!r:.80}: {image!r:.40} is no name of an image: give one by --image")
        return cls(text, image)

    def __str__(self) -> str:
        return self.text if self.image is None else f"{_IMAGE}{self.image} {self.text}"

    def in_image(self, image: str | None) -> PlannerSpec:
        """The same planner in an image; as it is for None. Raises InputError."""
        if image is None:
            return self
        if self.image is not None:
            raise InputError(f"--image {image}: {str(self)!r} names an image already")
        if not image or image.startswith("-") or any(map(str.isspace, image)):
            raise InputError(f"--image {image!r}: is no name of an image")
        return replace(self, image=image)

    @property
    def base(self) -> str:
        """Without the `-e` of an expert."""
        return self.text.removesuffix(EXPERT)

    @property
    def isolated_only(self) -> bool:
        """Is it a program, or driven in an image?"""
        return self.image is not None or self.text.startswith(EXECUTABLE)

    @property
    def program(self) -> Path | None:
        """The file of `exe:FILE`, None for what is Python."""
        return Path(self.text.removeprefix(EXECUTABLE)).resolve() if self.text.startswith(EXECUTABLE) else None

    def executable(self) -> Path | None:
        """`program`, checked. Raises InputError for a file that cannot be executed."""
        path = self.program
        if path and not (path.is_file() and os.access(path, os.X_OK)):
            raise InputError(f"planner {self.text!r}: {path} is no file that can be executed")
        return path


def parts_of(base: str) -> tuple[str, str, str]:
    """(`nuplan:` or "", module or file, attribute with its arguments) of a specification that is no registered name."""
    if base.startswith(NUPLAN):
        source, _, attribute = base.removeprefix(NUPLAN).partition(":")
        return NUPLAN, source, attribute
    source, _, attribute = base.rpartition(":")
    return "", source, attribute
