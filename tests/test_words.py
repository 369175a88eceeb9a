"""Tests that the code speaks plain technical English, as far as a machine can tell."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

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


def docstrings(path: Path) -> Iterator[tuple[ast.AST, str]]:
    """Yield every docstring of a file with the node it belongs to."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            text = ast.get_docstring(node)
            if text is not None:
                yield node, text


def is_property(node: ast.AST) -> bool:
    """Return whether a function is read as an attribute; its docstring may be a noun phrase."""
    names = [ast.unparse(d) for d in getattr(node, "decorator_list", [])]
    return any(
        name.split("(")[0].rsplit(".", 1)[-1] in {"property", "cached_property", "fixture"} for name in names
    )


def place(path: Path, node: ast.AST) -> str:
    """Return `file:line name` of a node."""
    return f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 1)} {getattr(node, 'name', '(module)')}"


def by_file(paths: list[Path]) -> pytest.MarkDecorator:
    """Return a parametrisation with one case per file."""
    return pytest.mark.parametrize("path", paths, ids=lambda p: str(p.relative_to(ROOT)))


@by_file(FILES)
def test_first_word_of_a_docstring(path: Path) -> None:
    wrong = []
    for node, text in docstrings(path):
        first = re.split(r"[^A-Za-z]", text.strip("`'\"("))[0].lower()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not is_property(node):
            if first not in VERBS:
                wrong.append(
                    f"{place(path, node)}: {text.splitlines()[0]!r} does not begin with an imperative verb"
                )
        elif first in FIRST_WORDS_REFUSED:
            wrong.append(f"{place(path, node)}: {text.splitlines()[0]!r} is not a noun phrase")
    assert not wrong, "\n".join(wrong)


def prose(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, text) of every comment and string literal of a file."""
    source = path.read_text()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.lineno, node.value
    for number, line in enumerate(source.splitlines(), 1):
        if match := re.search(r"(?:^|\s)#\s(.*)$", line):
            yield number, match[1]


@by_file(FILES)
def test_no_forbidden_word_in_docstrings_comments_and_messages(path: Path) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{number}: '{found[0]}' in {text[max(0, found.start() - 30) : found.end() + 30]!r}"
        for number, text in prose(path)
        if (found := FORBIDDEN_PROSE.search(text)) and (str(path.relative_to(ROOT)), found[0]) not in ALLOWED
    ]
    assert not wrong, "\n".join(wrong)


def names(path: Path) -> Iterator[tuple[int, str]]:
    """Yield (line, name) of everything that a file defines: classes, functions, arguments and variables."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            yield node.lineno, node.name
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.attr


def snake(name: str) -> str:
    """Convert CamelCase to snake_case."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


@by_file(FILES)
def test_names_are_the_fields_terms(path: Path) -> None:
    wrong = {
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for line, name in names(path)
        if FORBIDDEN_NAMES.search(snake(name))
    }
    assert not wrong, "\n".join(sorted(wrong))


@by_file(TEST_FILES)
def test_test_names_are_short(path: Path) -> None:
    long = [
        f"{place(path, node)}"
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.FunctionDef)
        and node.name.startswith("test_")
        and len(node.name.removeprefix("test_")) > LONGEST_TEST_NAME
    ]
    assert not long, "\n".join(long)


@pytest.mark.parametrize(
    "path",
    sorted([*(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb")]),
    ids=lambda p: str(p.relative_to(ROOT)),
)
def test_no_forbidden_word_in_pages(path: Path) -> None:
    wrong = [
        f"{path.relative_to(ROOT)}:{number}: '{found[0]}'"
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if '"image/png"' not in line and (found := FORBIDDEN_PROSE.search(line))
    ]
    assert not wrong, "\n".join(wrong)
