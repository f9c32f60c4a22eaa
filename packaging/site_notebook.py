"""`guides/NAME_notebook.md` of the site: a notebook as a page, made from its cells when the site is built."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

_WRITE, _SHELL = "%%writefile ", "!"


def notebook_page(notebook: str, file: str) -> str:
    """The page as Markdown, with a link to the notebook itself. `file`: its path from the page.

    The notebook is kept without what its cells print, so the page shows none of it.
    """
    cells: list[dict[str, Any]] = json.loads(notebook)["cells"]
    parts = list(_parts(cells))
    title, _, rest = parts[0].partition("\n")
    return "\n\n".join([title, f"[Download the notebook]({file}).", rest.strip(), *parts[1:]]) + "\n"


def _parts(cells: list[dict[str, Any]]) -> Iterator[str]:
    for cell in cells:
        source = "".join(cell["source"]).strip()
        if cell["cell_type"] == "markdown":
            yield source
            continue
        first, _, rest = source.partition("\n")
        # The file that the cell writes is its title: a reader without Jupyter writes it by hand.
        name = first.removeprefix(_WRITE) if first.startswith(_WRITE) else None
        if name:
            yield f'```python title="{name}"\n{rest}\n```'
        elif all(line.startswith(_SHELL) for line in source.splitlines()):
            commands = "\n".join(line.removeprefix(_SHELL) for line in source.splitlines())
            yield f"```sh\n{commands}\n```"
        else:
            yield f"```python\n{source}\n```"
