"""Tests that the code speaks plain technical English, as far as a machine can tell."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
FILES = sorted((ROOT / "arena").rglob("*.py"))
TEST_FILES = sorted((ROOT / "tests").rglob("test_*.py"))

VERBS = set((ROOT / "tests" / "imperative_verbs.txt").read_text().split())
FIRST_WORDS_REFUSED = {
    "of",
    "what",
    "they",
    "where",
    "she",
    "those",
    "whether",
    "which",
    "its",
    "who",
    "these",
    "whose",
    "it",
    "this",
    "while",
    "one",
    "when",
    "whom",
    "that",
    "he",
}
# Words that hide their meaning: figurative, old-fashioned, or private to this project.
FORBIDDEN = (
    r"afterlife|aforesaid|anew|befall\w*|beheld|bestow\w*|chronicle\w*|deaf|deeds?|doers?|ears|forgiven|hears?|heard|"
    r"hearing|helm|henceforth|hope[sd]?|mended|nought|of old|shall|sterner|spoil\w*|straightway|tells?|telling|thereof|"
    r"thereby|told|uttered|utters|whence|wherein|whereof|whom|words of its own"
)
FORBIDDEN_PROSE = re.compile(rf"\b(?:{FORBIDDEN})\b", re.IGNORECASE)
FORBIDDEN_NAMES = re.compile(
    r"(?:^|_)(?:afterlife|chronicle|deaf|deeds?|doer|ears|eyes|forgiven|hear|hears|heard|helm|hope|nought|spoil|spoiled|"
    r"spoiling|sterner|tell|tells|told|speak|speaks|spoken)(?:_|$)",
    re.IGNORECASE,
)
LONGEST_TEST_NAME = 75
ALLOWED = {("arena/smoke/language/vocabulary.py", "told")}
"""Words that users' files may still contain, with the module that reads them."""


def is_property(node: ast.AST) -> bool:
    """Return whether a function is read as an attribute; its docstring may be a noun phrase."""
    names = [ast.unparse(d) for d in getattr(node, "decorator_list", [])]
    return any(
        name.split("(")[0].rsplit(".", 1)[-1] in {"property", "cached_property", "fixture"} for name in names
    )


def place(path: Path, node: ast.AST) -> str:
    """Return `file:line name` of a node."""
    return f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)} {getattr(node, 'name', '(module)')}"


def by_folder(paths: list[Path]) -> pytest.MarkDecorator:
    """Return a parametrisation with one case per folder or module below `arena`, `tests` and `docs`.

    A case per file would cost more time in pytest than the test itself. The messages name file and line.
    """
    folders: dict[str, list[Path]] = {}
    for path in paths:
        folders.setdefault("/".join(path.relative_to(ROOT).parts[:2]), []).append(path)
    return pytest.mark.parametrize("paths", folders.values(), ids=folders.keys())


class Docstring(NamedTuple):
    """A docstring. place: `file:line name`. verb: whether it must begin with a verb."""

    place: str
    verb: bool
    text: str


class Words(NamedTuple):
    """The words of a file. docstrings: those of everything. prose: (line, text) of every comment and string literal.

    names: (line, name) of everything that the file defines: classes, functions, arguments and variables.
    """

    docstrings: list[Docstring]
    prose: list[tuple[int, str]]
    names: list[tuple[int, str]]


@cache  # one syntax tree serves all tests of a file
def words(path: Path) -> Words:
    """Read a file of Python."""
    source = path.read_text()
    found = Words([], [], [])
    for node in ast.walk(ast.parse(source)):
        found.names.extend(defined(node))
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.prose.append((node.lineno, node.value))
        elif isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            verb = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not is_property(node)
            if text is not None:
                found.docstrings.append(Docstring(place(path, node), verb, text))
    for number, line in enumerate(source.splitlines(), 1):
        if match := re.search(r"(?:^|\s)#\s(.*)$", line):
            found.prose.append((number, match[1]))
    return found


def defined(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield (line, name) of what a node defines, if it defines something."""
    if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
        yield node.lineno, node.name
    elif isinstance(node, ast.arg):
        yield node.lineno, node.arg
    elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.lineno, node.id
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
        yield node.lineno, node.attr


@by_folder(FILES)
def test_first_word_of_a_docstring(paths: list[Path]) -> None:
    wrong = []
    for where, verb, text in (docstring for path in paths for docstring in words(path).docstrings):
        first = re.split(r"[^A-Za-z]", text.strip("`'\"("))[0].lower()
        if verb:
            if first not in VERBS:
                wrong.append(f"{where}: {text.splitlines()[0]!r} does not begin with an imperative verb")
        elif first in FIRST_WORDS_REFUSED:
            wrong.append(f"{where}: {text.splitlines()[0]!r} is not a noun phrase")
    assert not wrong, "\n".join(wrong)


@by_folder(FILES)
def test_no_forbidden_word_in_docstrings_comments_and_messages(paths: list[Path]) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{number}: '{found[0]}' in {text[max(0, found.start() - 30) : found.end() + 30]!r}"
        for path in paths
        for number, text in words(path).prose
        if (found := FORBIDDEN_PROSE.search(text)) and (str(path.relative_to(ROOT)), found[0]) not in ALLOWED
    ]
    assert not wrong, "\n".join(wrong)


def snake(name: str) -> str:
    """Convert CamelCase to snake_case."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


@by_folder(FILES)
def test_names_are_the_fields_terms(paths: list[Path]) -> None:
    wrong = {
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in paths
        for line, name in words(path).names
        if FORBIDDEN_NAMES.search(snake(name))
    }
    assert not wrong, "\n".join(sorted(wrong))


@by_folder(TEST_FILES)
def test_test_names_are_short(paths: list[Path]) -> None:
    long = [
        f"{place(path, node)}"
        for path in paths
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef)
        and node.name.startswith("test_")
        and len(node.name.removeprefix("test_")) > LONGEST_TEST_NAME
    ]
    assert not long, "\n".join(long)


@by_folder(sorted([*(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb")]))
def test_no_forbidden_word_in_pages(paths: list[Path]) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{number}: '{found[0]}'"
        for path in paths
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if '"image/png"' not in line and (found := FORBIDDEN_PROSE.search(line))
    ]
    assert not wrong, "\n".join(wrong)
