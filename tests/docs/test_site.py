"""Tests of the parts of the documentation site that are our own: navigation, links to files outside docs/, lists in docstrings.

`make site`, a part of `make test`, builds the whole site; there, every warning is an error.
"""

from __future__ import annotations

import importlib.util
from types import ModuleType

import pytest

from .pages import ROOT

pytest.importorskip("mkdocs")
pytest.importorskip("griffe")


def tool(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_navigation_has_the_sections_and_pages_of_the_index():
    index = (
        "# All\n\n**Tutorial.** [First](tutorial.md)\n\n"
        "**How to**\n\n- [Stop](howto/stop-everything.md): x\n- [CI](howto/run-in-ci.md)\n"
    )
    nav = tool("site_pages").navigation(index)
    assert [list(section) for section in nav][2] == ["How to"]
    assert list(nav[1].values()) == ["tutorial.md"]
    pages = nav[2]["How to"]
    assert [page for each in pages for page in each.values()] == [
        "howto/stop-everything.md",
        "howto/run-in-ci.md",
    ]


def test_notebook_in_the_index_becomes_a_page():
    index = "# All\n\n**How to**\n\n- [A](howto/analyse-a-run.ipynb): x\n- [CI](howto/run-in-ci.md)\n"
    (pages,) = [section["How to"] for section in tool("site_pages").navigation(index) if "How to" in section]
    assert pages[0] == {"Analyse a run with pandas": "howto/analyse-a-run.md"}


def test_links_that_leave_docs_are_found():
    find = tool("site_pages").outside
    assert find("[a](../../examples/x.yaml) [b](../programs.md) [c](https://e.org/../x)", "howto/p.md") == {
        "examples/x.yaml"
    }


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "Return x.\n\np_n: position [m] [NED] (3,).\nq: attitude",
            "Return x.\n\n- `p_n`: position \\[m] \\[NED] (3,).\n- `q`: attitude",
        ),
        ("A pose.\n\n    a, b: two\n      values\n", "A pose.\n\n- `a, b`: two values"),
        (
            "Send.\nnow: time [s]\n    of the clock\n\nRaises X.",
            "Send.\n\n- `now`: time \\[s] of the clock\n\nRaises X.",
        ),
        ("See `a[0]` and [b](c.md).", "See `a[0]` and [b](c.md)."),
    ],
)
def test_fields_of_docstrings_become_lists(text, expected):
    assert tool("docstring_fields").as_markdown(text) == expected
