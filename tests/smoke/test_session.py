"""Addresses for arenas, and arenas that are refused."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from arena.errors import InputError
from arena.schema import load_arena
from arena.smoke.flying.session import free_address


def test_address_of_a_listening_router_is_not_free():
    first = free_address()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as router:
        router.bind((first, 24000))
        assert free_address() != first


def test_real_vehicle_is_refused(tmp_path: Path):
    from arena.smoke.flying.fly_scenario import refuse_real

    (tmp_path / "arena.yaml").write_text(
        "mocap: {source: natnet, server: 127.0.0.2}\nvehicles:\n  uav1: {autopilot: builtin}\n"
        "  uav2: {autopilot: hardware, profile: iris, radio: none, url: 'udpin:127.0.0.1:14600', start: {position: [2, 0, 0]}}\n"
    )
    with pytest.raises(InputError, match=r"got vehicles with real flight controllers \(uav2\)"):
        refuse_real(load_arena(tmp_path / "arena.yaml"))
