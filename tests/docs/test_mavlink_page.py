"""The page of messages and commands is what the tables of the built-in autopilot say today."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

import mavlink_reference


def test_page_of_messages_is_up_to_date():
    written = mavlink_reference.PAGE.read_text()
    assert written == mavlink_reference.page(), "write it again: python benchmarks/mavlink_reference.py"


def test_every_note_belongs_to_a_row_of_the_page():
    page = mavlink_reference.page()
    notes = (mavlink_reference._EVENTS, mavlink_reference._WHEN, mavlink_reference._RECEIVED)
    names = [name for each in notes for name in each]
    names += [name.removeprefix("MAV_CMD_") for name in mavlink_reference._COMMAND_NOTES]
    assert not [name for name in names if f"| `{name}` |" not in page]
