"""For MkDocs (`mkdocs.yml`): what pages show of the repository around them.

Links to files that are no pages become the names of those files, and have to lead to one. Into the site come a page of
all commands that is made from the code, a page of each notebook and a page of each scenario type, with its plates and
drives. The last take a minute: they are made in `build/signs` where they are not there.
"""

from __future__ import annotations

import logging
import re
import sys
from pathlib import Path, PurePosixPath
from typing import Any

_ROOT = Path(__file__).resolve().parents[1]
_DOCS = _ROOT / "docs"
_SIGNS = _ROOT / "build" / "signs"
_LINK = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:|#|mailto:)([^)\s#]+)(#[^)\s]*)?\)")
# Each becomes a page beside it: NAME_notebook.md.
NOTEBOOKS = ("guides/first_run.ipynb", "guides/learn_from_drives.ipynb")
_LOG = logging.getLogger("mkdocs.hooks.site")  # a warning here ends a strict build


def on_files(files: Any, config: Any) -> Any:
    """The site's files, with the pages that are made from code and scenes."""
    from mkdocs.structure.files import File

    sys.path[:0] = [str(_ROOT), str(Path(__file__).parent)]  # a hook is loaded by its path alone
    from site_commands import commands_page
    from site_notebook import notebook_page

    files.append(File.generated(config, "reference/commands.md", content=commands_page()))
    for notebook in NOTEBOOKS:
        page = notebook_page((_DOCS / notebook).read_text(encoding="utf-8"), Path(notebook).name)
        files.append(File.generated(config, _page_name(notebook), content=page))

    for file in _sign_files():
        name = f"signs/{file.relative_to(_SIGNS).as_posix()}"
        files.append(File.generated(config, name, abs_src_path=str(file)))
    return files


def _sign_files() -> list[Path]:
    """Pages of scenario types with their pictures. The index is the last to be written, and says that all are there."""
    if not (_SIGNS / "README.md").is_file():
        from sign_pages import PageMaker

        from tsbench.scenarios.data_set import DataSet

        maker = PageMaker(DataSet(), _SIGNS)
        for name in maker.types:
            maker.write(name)
        maker.write_index()
    return sorted(path for path in _SIGNS.rglob("*") if path.is_file())


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """A page's text as the site shows it (on disk its links lead on into the repository); its title and description."""
    place = PurePosixPath(page.file.src_uri)
    known = config.extra["pages"]
    of_type = place.parent.name == "signs" and place.name != "README.md"
    title, description = _of_type(page.title) if of_type else known[str(place)]
    page.meta |= {"title": title, "description": description}
    return without_links_out(markdown, place)


def _of_type(name: str) -> tuple[str, str]:
    """Title and description of the page of a scenario type."""
    return (
        f"{name} traffic sign: rule, law, films",
        f"{name}: the traffic sign, its law, rule and thresholds, and films of planners in SUMO that break and obey it",
    )


def without_links_out(markdown: str, place: PurePosixPath) -> str:
    """The text with links that leave the folder of pages as their words, and the file that they name beside them.

    A link to a file that is not there is a warning. One to a notebook leads to its page.
    """

    def plain(link: re.Match[str]) -> str:
        target = (_DOCS / place.parent / link[2]).resolve()
        if target in {_DOCS / notebook for notebook in NOTEBOOKS} and place.name != _page_name(target.name):
            return _page_name(link[0])
        if target.is_relative_to(_DOCS):
            return link[0]
        if not target.exists() or not target.is_relative_to(_ROOT):
            _LOG.warning("Doc file '%s' contains a link '%s', but there is no such file.", place, link[2])
            return link[0]
        path = target.relative_to(_ROOT).as_posix()
        if link[1].strip("`") == target.name:
            return f"`{path}`"
        return link[1] if path in link[1] else f"{link[1]} (`{path}`)"

    return _LINK.sub(plain, markdown)


def _page_name(notebook: str) -> str:
    return notebook.replace(".ipynb", "_notebook.md")
