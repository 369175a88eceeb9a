"""The key `log.foxglove`: forms, and the address that the server binds."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.errors import InputError
from arena.schema import Arena, load_arena

VEHICLES = "vehicles: {uav1: {autopilot: builtin}}\n"


def load(folder: Path, text: str, *overrides: str) -> Arena:
    file = folder / "arena.yaml"
    file.write_text(text + VEHICLES)
    return load_arena(file, list(overrides))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ("true", ("127.66.1.1", 8765)),
        ("false", None),
        ("8766", ("127.66.1.1", 8766)),
        ("{port: 8767}", ("127.66.1.1", 8767)),
        ("{address: 192.168.1.5}", ("192.168.1.5", 8765)),
        ("{}", ("127.66.1.1", 8765)),
    ],
)
def test_each_form_gives_the_address_of_the_server(tmp_path, value, expected):
    assert load(tmp_path, f"address: 127.66.1.1\nlog: {{foxglove: {value}}}\n").foxglove == expected


def test_default_is_no_server(tmp_path):
    assert load(tmp_path, "").foxglove is None


def test_command_line_replaces_the_yaml(tmp_path):
    assert load(tmp_path, "log: {foxglove: false}\n", "log.foxglove=true").foxglove == ("127.0.0.1", 8765)


@pytest.mark.parametrize("value", ["80", "'yes'", "[8765]", "{port: 8765, password: x}", "{address: lab}"])
def test_other_values_are_refused(tmp_path, value):
    with pytest.raises(InputError, match="foxglove"):
        load(tmp_path, f"log: {{foxglove: {value}}}\n")
