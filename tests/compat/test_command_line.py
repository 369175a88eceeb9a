"""Command line of a program that was written for the thesis's launcher."""

from __future__ import annotations

import json
import sys

import pytest

from arena.compat import command_line
from arena.errors import InputError

PROFILE = {"name": "iris", "mass_kg": 1.52, "radius_m": 0.275, "height_m": 0.1, "num_rotors": 4}


@pytest.fixture(autouse=True)
def no_settings(monkeypatch):
    monkeypatch.setattr(command_line, "_settings_file", [])


def test_arguments_are_those_of_the_launcher_and_then_those_of_the_yaml(tmp_path, monkeypatch):
    file = tmp_path / "program.uav7.json"
    file.write_text(json.dumps({"vehicle": "uav7", "clock": "/tmp/clock", "profile": PROFILE}))
    monkeypatch.setattr(sys, "argv", ["follower.py", "--uav", str(file), "4", "2", "0.25"])
    command_line.translate()
    assert sys.argv == ["follower.py", "uav7", "1.52", "0.275", "0.1", "4", "iris", "4", "2", "0.25"]
    assert command_line.uav_options("uav7") == ["--uav", str(file)]
    assert (command_line.vehicle_name(), command_line.clock_path()) == ("uav7", "/tmp/clock")


def test_program_started_by_hand_keeps_its_arguments(monkeypatch):
    argv = ["follower.py", "uav2", "1.52", "0.275", "0.1", "4", "iris", "4"]
    monkeypatch.setattr(sys, "argv", list(argv))
    command_line.translate()
    assert sys.argv == argv
    assert command_line.uav_options("uav2") == ["--ns", "uav2"]
    assert command_line.vehicle_name() is None and command_line.clock_path() is None


def test_settings_file_that_cannot_be_read_is_an_error(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["follower.py", "--uav", str(tmp_path / "none.json")])
    with pytest.raises(InputError, match=r"none\.json"):
        command_line.translate()
