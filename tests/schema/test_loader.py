"""YAML 1.2 scalars, lines, and what comes back from `dump_yaml`."""

from __future__ import annotations

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from arena.schema import loader
from arena.schema.loader import dump_yaml, parse_yaml

SCALARS: dict[str, Any] = {
    "no": "no",
    "No": "No",
    "yes": "yes",
    "on": "on",
    "off": "off",
    "y": "y",
    "true": True,
    "False": False,
    "TRUE": True,
    "010": 10,
    "0o17": 15,
    "0x1F": 31,
    "+3": 3,
    "-0": 0,
    "1_000": "1_000",
    "0b11": "0b11",
    "12:30": "12:30",
    "190:20:30": "190:20:30",
    "1e-3": 1e-3,
    "1E5": 1e5,
    ".5": 0.5,
    "1.": 1.0,
    "-1.5e+2": -150.0,
    ".inf": math.inf,
    "-.INF": -math.inf,
    "~": None,
    "null": None,
    "": None,
    "2001-01-01": "2001-01-01",
    "=": "=",
    '"12"': "12",
    "'no'": "no",
    "3.1": 3.1,
    "'3.1'": "3.1",
    "1.2.3": "1.2.3",
    "0x": "0x",
    "nan": "nan",
    "inf": "inf",
}


@pytest.mark.parametrize("text", SCALARS)
def test_a_scalar_is_what_yaml_1_2_says(text: str) -> None:
    got = parse_yaml(f"key: {text}", "f").data["key"]
    assert got == SCALARS[text] and type(got) is type(SCALARS[text])


def test_nan_is_parsed() -> None:
    assert math.isnan(parse_yaml("key: .NaN", "f").data["key"])


def test_every_key_and_item_has_its_line() -> None:
    document = parse_yaml("# top\na:\n  b: 1\n  c:\n    - x\n    - {d: 2,\n       e: 3}\n", "f")
    lines = {
        ("a",): 2,
        ("a", "b"): 3,
        ("a", "c"): 4,
        ("a", "c", 0): 5,
        ("a", "c", 1): 6,
        ("a", "c", 1, "d"): 6,
        ("a", "c", 1, "e"): 7,
    }
    assert document.lines == lines
    assert document.line(("a", "c", 1, "missing")) == 6 and document.line(("nowhere",)) == 1


def test_crlf_and_byte_order_mark_are_accepted() -> None:
    document = parse_yaml("a: 1\r\nb: 2\r\n", "f")
    assert document.data == {"a": 1, "b": 2} and document.lines["b",] == 2


plain = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False)
    | st.text("abn019.:-_ex~#{}[]'\" \n", max_size=8)
    | st.sampled_from(list(SCALARS)),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text("abc", min_size=1, max_size=3), inner, max_size=3)
    ),
    max_leaves=8,
)


def tupled(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: tupled(v) for k, v in value.items()}
    return tuple(tupled(v) for v in value) if isinstance(value, list) else value


@given(plain)
def test_dumped_yaml_is_read_back_equal(value: Any) -> None:
    got = parse_yaml(dump_yaml({"key": value}), "f").data["key"]
    assert got == tupled(value) and type(got) is type(tupled(value))


@settings(max_examples=30)
@given(
    st.recursive(
        st.one_of(st.booleans(), st.integers(), st.text()),
        lambda inner: st.dictionaries(st.text(min_size=1), inner),
    )
)
def test_libyaml_and_the_python_parser_read_the_same(value: Any) -> None:
    text = dump_yaml({"value": value})
    fast = parse_yaml(text, "x")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loader, "_FastLoader", None)
        slow = parse_yaml(text, "x")
    assert fast == slow
