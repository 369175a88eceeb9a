"""Tests of the pages: links resolve, messages exist in the code, no path of one machine is in them."""

from __future__ import annotations

import ast
import re
import tempfile
from functools import cache
from pathlib import Path

import pytest

from arena.schema.models import NOT_YET

from .pages import NOTEBOOKS, PAGES, ROOT, notebook_page, page_text

_CODE = re.compile(r"```.*?```|`[^`]*`", re.S)
_LINK = re.compile(r"\]\(([^)\s]+)\)")
IDS = [str(page.relative_to(ROOT)) for page in PAGES]


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_internal_links_resolve(page):
    stored = notebook_page(page)[1] if page in NOTEBOOKS else {}
    for link in _LINK.findall(_CODE.sub("", page_text(page))):
        if not link.startswith("https://") and link not in stored:
            path, _, anchor = link.partition("#")
            target = page.parent / path if path else page
            assert target.is_file(), link
            assert not anchor or anchor in anchors(target), link


def anchors(page: Path) -> set[str]:
    """Return the anchors of the headings of a page."""
    heads = re.findall(r"^#+ (.+)$", page_text(page), re.M)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def test_every_page_is_in_the_index():
    index = ROOT / "docs" / "index.md"
    listed = {(index.parent / link).resolve() for link in _LINK.findall(index.read_text())}
    assert {page for page in PAGES if page.parent != ROOT} - listed == {index}


@pytest.mark.parametrize("page", PAGES, ids=IDS)
def test_no_page_contains_a_path_of_one_machine(page):
    # Paths of this machine are computed, because the test must not contain them either.
    here = {str(Path.home()), str(ROOT), str(ROOT.parent), tempfile.gettempdir()} - {"/"}
    for word in (*(re.escape(f"{folder}/") for folder in here), r"/home/\w+", r"index-url"):
        assert not re.search(word, page_text(page)), word


def test_pictures_of_the_readme_are_small():
    pictures = re.findall(r"!\[.+?\]\((.+?)\)", (ROOT / "README.md").read_text())
    sizes = {name: (ROOT / name).stat().st_size for name in pictures}
    assert sizes.pop("docs/images/swarm.gif") < 2_500_000
    assert sizes and all(10_000 < size < 300_000 for size in sizes.values()), sizes


@pytest.mark.parametrize("word", sorted({value or key.rpartition(".")[2] for key, value in NOT_YET}))
def test_readme_names_unavailable_yaml_values(word):
    text = (ROOT / "README.md").read_text().partition("## What works")[2].partition("\n## Install")[0]
    assert word in text or word in DETAILS


# Keys that are used only together with one that the README names.
DETAILS: set[str] = set()


# -- troubleshooting ---------------------------------------------------------------------------------------------------

TROUBLE = (ROOT / "docs/troubleshooting.md").read_text()
MESSAGES = re.findall(r"^### `(.+)`$", TROUBLE, re.M)


@pytest.mark.parametrize("message", MESSAGES)
def test_troubleshooting_messages_exist_in_the_code(message):
    wanted = [part for part in message.split("…") if part.strip(" ;:()")]
    assert any(in_order(wanted, text) for text in texts()), message


@pytest.mark.parametrize(
    "message", ["the vehicle has left OFFBOARD", "the vehicle left OFFBOARD … and was in …"]
)
def test_missing_troubleshooting_message_is_detected(message):
    with pytest.raises(AssertionError):
        test_troubleshooting_messages_exist_in_the_code(message)


def in_order(parts: list[str], text: str) -> bool:
    at = 0
    for part in parts:
        found = text.find(part, at)
        if found < 0:
            return False
        at = found + len(part)
    return True


@cache
def texts() -> tuple[str, ...]:
    """Return every string of the package and of its tools, with `…` for inserted values, and the Makefile."""
    found = [(ROOT / "Makefile").read_text()]
    for path in sorted([*(ROOT / "arena").rglob("*.py"), *(ROOT / "tools").glob("*.py")]):
        found += [told for node in ast.walk(ast.parse(path.read_text())) if (told := told_by(node))]
    return tuple(found)


def told_by(node: ast.AST) -> str:
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(str(part.value) if isinstance(part, ast.Constant) else "…" for part in node.values)
    return ""


# -- glossary ----------------------------------------------------------------------------------------------------------


def test_glossary_is_sorted_and_has_one_line_per_term():
    lines = (ROOT / "docs/reference/glossary.md").read_text().splitlines()
    terms = [line.split(" | ")[0].removeprefix("| ") for line in lines if line.startswith("| ")][1:]
    assert len(terms) > 80
    assert terms == sorted(set(terms), key=str.lower)
