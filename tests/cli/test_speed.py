"""The option --speed of `arena up`, `arena smoke` and `arena replay`."""

from __future__ import annotations

import pytest

from arena.cli import main
from arena.cli._options import speed_of
from arena.errors import InputError


@pytest.mark.parametrize("text", ["fast", "0", "-1", "nan", "2000", ""])
def test_wrong_speed_is_refused(text):
    with pytest.raises(InputError, match="--speed: got"):
        speed_of(text)


def test_speed_is_a_number_or_max():
    assert (speed_of("max"), speed_of("2")) == ("max", 2.0)


@pytest.mark.parametrize("command", ["up", "smoke"])
def test_error_names_the_option_that_the_user_has_given(tmp_path, capsys, command):
    file = tmp_path / "arena.yaml"
    file.write_text("vehicles: {uav1: {}}\n")
    assert main([command, str(file), "--speed", "fast"]) == 2
    error = capsys.readouterr().err
    assert "--speed: got fast, expected a number above 0 and at most 1000, or max" in error
    assert "--set" not in error
