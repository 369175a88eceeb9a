"""Addresses for arenas, and arenas that are refused."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from arena.errors import InputError
from arena.schema import load_arena
from arena.smoke.flying.session import LaunchOptions, Session, free_address


def test_address_of_a_listening_router_is_not_free():
    first = free_address()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as router:
        router.bind((first, 24000))
        assert free_address() != first


@pytest.mark.parametrize(("text", "has"), [(None, False), ("{", False), ('{"exit_code": 0}', True)])
def test_session_reports_whether_its_run_has_an_outcome(tmp_path: Path, text: str | None, has: bool):
    session = Session(LaunchOptions(arena=tmp_path / "arena.yaml", runs=tmp_path))
    try:
        assert not session.has_outcome  # no run folder
        session.run = tmp_path
        if text is not None:
            (tmp_path / "outcome.json").write_text(text)
        assert session.has_outcome is has
    finally:
        session.run = None
        session.close()


def test_real_vehicle_is_refused(tmp_path: Path):
    from arena.smoke.flying.fly_scenario import refuse_real

    (tmp_path / "arena.yaml").write_text(
        "mocap: {source: natnet, server: 127.0.0.2}\nvehicles:\n  uav1: {autopilot: builtin}\n"
        "  uav2: {autopilot: hardware, profile: iris, radio: none, url: 'udpin:127.0.0.1:14600', start: {position: [2, 0, 0]}}\n"
    )
    with pytest.raises(InputError, match=r"got vehicles with real flight controllers \(uav2\)"):
        refuse_real(load_arena(tmp_path / "arena.yaml"))
