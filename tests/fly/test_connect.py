"""`arena.connect`: which vehicles it opens."""

from __future__ import annotations

import importlib
from types import SimpleNamespace

import pytest

from arena.errors import InputError

connecting = importlib.import_module("arena.fly.connect")  # `arena.fly.connect` is the function


@pytest.fixture
def opened(monkeypatch):
    """Names of the opened vehicles. The running arena has the real vehicle uav1 and the simulated vehicle uav2."""
    names = []
    found = lambda name, run: SimpleNamespace(name=name or "uav1", is_real=name != "uav2")  # noqa: E731
    monkeypatch.setattr(connecting, "find_vehicle", found)
    monkeypatch.setattr(connecting, "open_uav", lambda vehicle, lockstep: names.append(vehicle.name))
    return names


@pytest.mark.parametrize("name", [None, "uav1"])
def test_real_vehicle_is_not_opened_without_real(opened, name):
    with pytest.raises(InputError, match="real=True"):
        connecting.connect(name)
    assert opened == []


def test_real_vehicle_with_real_and_simulated_vehicle_are_opened(opened):
    connecting.connect("uav1", real=True)
    connecting.connect("uav2")
    assert opened == ["uav1", "uav2"]
