"""What stands behind `--planner`: taken apart, for which nothing is imported, and imported, module or file.

Whatever goes wrong becomes one line with its place and its remedy.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import os
import sys
import traceback
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Final

import tsbench
from tsbench.core.errors import CHECKOUTS, InputError, cause_of, install_command

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


def import_attribute(source: str, attribute: str, where: str) -> object:
    """The attribute (dotted names descend) of a module, or of a file ending in `.py`.

    `where` begins the line of the InputError for a missing attribute.
    """
    module = _from_file(Path(source), where) if source.endswith(".py") else _from_module(source, where)
    found: object = module
    for part in attribute.split("."):
        if not hasattr(found, part):
            raise InputError(f"{where}: {source} has no {attribute}{_offers(module)}")
        found = getattr(found, part)
    return found


def _offers(module: ModuleType) -> str:
    own = [
        name
        for name, value in vars(module).items()
        if callable(value) and name[0] != "_" and getattr(value, "__module__", "") == module.__name__
    ]
    return f" (it defines {', '.join(own[:8])})" if own else ""


def _from_module(name: str, where: str) -> ModuleType:
    # The console script does not look into the folder that the user stands in; `python -m` does.
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name is not None and (name == error.name or name.startswith(f"{error.name}.")):
            remedy = _remedy(error) if error.name in CHECKOUTS else ""
            raise InputError(f"{where}: there is no module {error.name}{remedy}") from None
        raise InputError(f"{where}: {name} does not import: {cause_with_place(error)}") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise InputError(f"{where}: {name} does not import: {cause_with_place(error)}") from error


def _from_file(path: Path, where: str) -> ModuleType:
    if not path.is_file():
        raise InputError(f"{where}: there is no file {path}")
    path = path.resolve()
    # Two files of one name are two modules; the same file is imported once.
    name = f"tsbench_user_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{where}: {path} cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    # Its neighbours can be imported, as when Python runs the file.
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    try:
        spec.loader.exec_module(module)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        del sys.modules[name]
        raise InputError(f"{where}: {path} does not import: {cause_with_place(error)}") from error
    return module


def cause_with_place(error: BaseException) -> str:
    """The error in one line, with the file and the line of its cause, and how to install what it lacks."""
    if isinstance(error, SyntaxError):
        return f"{type(error).__name__}: {error.msg} ({error.filename}, line {error.lineno})"
    frames = [f for f in traceback.extract_tb(error.__traceback__) if not f.filename.startswith("<")]
    own = [f for f in frames if f.filename != __file__ and "importlib" not in f.filename]
    place = f" ({own[-1].filename}, line {own[-1].lineno})" if own else ""
    return f"{cause_of(error).removesuffix(': ')}{place}{_remedy(error)}"


def _remedy(error: BaseException) -> str:
    """What to do about a module that is not there; "" for other errors."""
    if not isinstance(error, ModuleNotFoundError) or not error.name:
        return ""
    if error.name.partition(".")[0] == tsbench.__name__:
        return f"; tsbench {tsbench.__version__} has no such module"
    return f"; to install it: {install_command(error.name)}"
