"""The comparison of the PX4 contract, and its recorded data. The contract itself is flown by benchmarks/contract.py."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from px4_contract.cases import all_cases
from px4_contract.known import KNOWN
from px4_contract.table import BEGIN, END, put_into, section
from px4_contract.transcript import Seen, Transcript, compare, dump, fits, idle, load, same

RECORDED = Path(__file__).parents[2] / "benchmarks" / "px4_contract" / "px4-v1.16.json"


def number(value, **tolerance):
    return Seen(value=value, kind="number", **tolerance)


@pytest.mark.parametrize(
    ("px4", "builtin", "alike"),
    [
        (Seen(value="accepted"), Seen(value="accepted"), True),
        (Seen(value="accepted"), Seen(value="denied"), False),
        (Seen(value=True), Seen(value=1), False),
        (number(1.0, near=0.2), number(1.19, near=0.2), True),
        (number(1.0, near=0.2), number(1.21, near=0.2), False),
        (number(10.0, near=0.2, part=0.1), number(10.9), True),
        (number(10.0, near=0.2, part=0.1), number(11.1), False),
        (number(None, near=9.0), number(1.0, near=9.0), False),
        (number("nan", near=9.0), number("nan", near=9.0), True),
        (number(1.0, near=9.0), number("nan", near=9.0), False),
        (Seen(value="one", kind="words"), Seen(value="two", kind="words"), True),
    ],
)
def test_observations_are_compared_by_kind_and_tolerance(px4, builtin, alike):
    assert same(px4, builtin) is alike


def test_every_kind_of_difference_is_found():
    px4 = {
        "a": {"x": Seen(value=1), "only px4": Seen(value=2), "talk": Seen(value="t", kind="words")},
        "not run": {},
    }
    builtin = {"a": {"x": Seen(value=3), "only builtin": Seen(value=4)}}
    assert [d.key for d in compare(px4, builtin, {})] == ["a: x", "a: only px4", "a: only builtin"]


def test_known_difference_has_a_reason():
    px4, builtin = (
        {"a": {"x": Seen(value=1), "y": Seen(value=1)}},
        {"a": {"x": Seen(value=2), "y": Seen(value=2)}},
    )
    known = {"a: x": "because", "a: gone*": "once"}
    found = compare(px4, builtin, known)
    assert [d.reason for d in found] == ["because", ""]
    assert idle(known, found) == ["a: gone*"]


def test_pattern_supports_stars_and_character_sets_only():
    assert fits("a: list 3", "a: list [3-5]") and not fits("a: list 6", "a: list [3-5]")
    assert fits("a: really?", "a: *?") and not fits("a: really!", "a: *?")


def test_repeated_observation_is_kept_twice():
    t = Transcript()
    t.note("ack", "accepted")
    t.note("ack", "denied")
    assert {k: s.value for k, s in t.seen.items()} == {"ack": "accepted", "ack #2": "denied"}


def test_transcript_survives_a_round_trip():
    t = Transcript()
    t.note("ack", "accepted")
    t.number("rate", 10.0, near=0.5, part=0.1, unit="Hz")
    t.number("never", None)
    t.number("broken", float("nan"))
    t.words("texts", "4 hello")
    found = {"case": t.seen}
    assert load(json.loads(json.dumps(dump(found), allow_nan=False))) == found


def test_page_keeps_the_text_around_the_table():
    page = f"before\n\n{BEGIN}\nold\n{END}\n\nafter\n"
    new = section({"a": "what"}, {"a": 3}, [])
    assert put_into(page, new) == f"before\n\n{new}\n\nafter\n"


def test_recorded_transcript_is_readable_and_belongs_to_cases():
    recorded = load(json.loads(RECORDED.read_text()))
    assert set(recorded) <= set(all_cases())
    assert all(recorded.values())


def test_every_known_difference_names_a_case_and_a_reason():
    cases = [*all_cases()]
    for pattern, reason in KNOWN.items():
        assert any(fits(f"{name}: ", f"{pattern.split(': ')[0]}: ") for name in cases), pattern
        assert len(reason) > 15, pattern
