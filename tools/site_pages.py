"""Hooks of mkdocs for the documentation site.

They make the navigation from docs/index.md and pages from notebooks, and copy files outside docs/ to which pages link.

One place per fact: the order of the pages is that of docs/index.md. A page that is not listed there is a warning, and so an error.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from notebook_page import notebook_page

ROOT = Path(__file__).parents[1]
_SECTION = re.compile(r"^\*\*(.+?)\.?\*\*", re.M)
_LINK = re.compile(r"\[([^\]]+)\]\(([^)#\s]+\.(?:md|ipynb))\)")
_NOTEBOOK = re.compile(r"(\]\((?!https?:)[^)#\s]+)\.ipynb\b")
_OUTSIDE = re.compile(r"\]\((?!https?:)((?:\.\./)+)([^)#\s]+)")
_UNIT_FRAME = re.compile(r"(?<=\w)\] \[(?=[A-Z]+\])")
"""The middle of `[m] [NED]`, which Markdown would read as a link."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Set the navigation of the site."""
    config["nav"] = navigation((ROOT / "docs/index.md").read_text())
    return config


def navigation(index: str) -> list[dict[str, Any]]:
    """Return the navigation of mkdocs from the text of the index page: one section per bold heading, with its links in order."""
    parts = _SECTION.split(index)
    nav: list[dict[str, Any]] = [{"All pages": "index.md"}]
    for title, text in zip(parts[1::2], parts[2::2], strict=True):
        pages = [{_title(page): page.replace(".ipynb", ".md")} for _, page in _LINK.findall(text)]
        if len(pages) == 1:
            nav += pages
        elif pages:
            nav.append({title: pages})
    return nav


def _title(page: str) -> str:
    """Return the first heading of a page in docs/."""
    path = ROOT / "docs" / page
    text = notebook_page(path)[0] if path.suffix == ".ipynb" else path.read_text()
    found = re.search(r"^# (.+)$", text, re.M)
    return found[1] if found else page


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, and the files outside docs/ to which pages link, such as examples and CONTRIBUTING.md."""
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        text, pictures = notebook_page(ROOT / "docs" / notebook.src_uri)
        page = posixpath.splitext(notebook.src_uri)[0] + ".md"
        files.append(File.generated(config, page, content=text))
        for name, picture in pictures.items():
            files.append(
                File.generated(config, posixpath.join(posixpath.dirname(page), name), content=picture)
            )
    for page in [file for file in files if file.is_documentation_page()]:
        for name in outside(page.content_string, page.src_uri):
            if files.get_file_from_path(name) is None and (ROOT / name).is_file():
                files.append(File.generated(config, name, content=_content(ROOT / name)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Return the text of a page with links to notebooks and to files outside docs/ changed to their places in the site.

    The page of a notebook gets a link to the notebook below its title.
    """
    folder = posixpath.dirname(page.file.src_uri)

    def link(match: re.Match[str]) -> str:
        name = _name(folder, match[1] + match[2])
        return match[0] if name is None else f"]({posixpath.relpath(name, folder or '.')}"

    markdown = _UNIT_FRAME.sub(r"] \\[", _OUTSIDE.sub(link, _NOTEBOOK.sub(r"\1.md", markdown)))
    notebook = posixpath.basename(page.file.src_uri).removesuffix(".md") + ".ipynb"
    if files.get_file_from_path(posixpath.join(folder, notebook)) is None:
        return markdown
    return markdown.replace("\n", f"\n\nThis page is a notebook: [{notebook}]({notebook}).\n", 1)


def _content(path: Path) -> bytes | str:
    """Return the content of a file outside docs/. Links of a page to docs/ become links inside the site."""
    return path.read_text().replace("](docs/", "](") if path.suffix == ".md" else path.read_bytes()


def outside(text: str, page: str) -> set[str]:
    """Return the files outside docs/ to which a page links, as paths from the root of the repository.

    text: text of the page.  page: path of the page in docs/.
    """
    names = (_name(posixpath.dirname(page), up + rest) for up, rest in _OUTSIDE.findall(text))
    return {name for name in names if name is not None}


def _name(folder: str, link: str) -> str | None:
    """Return the path of a link from the root of the repository; None for a link inside docs/. folder: folder of the page in docs/."""
    path = posixpath.normpath(posixpath.join("docs", folder, link))
    return None if path.startswith("docs/") else path
