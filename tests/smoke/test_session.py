"""Addresses for arenas, and arenas that are refused."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from arena.errors import InputError, RunError
from arena.schema import load_arena
from arena.smoke.flying.fly_scenario import FlightOptions, fly, launch_options, slug
from arena.smoke.flying.session import LaunchOptions, Session, free_address
from arena.smoke.language.scenario import load_scenarios


def test_scenarios_with_the_same_folder_have_arena_files_of_their_own(tmp_path: Path):
    options = FlightOptions(results=tmp_path)
    (tmp_path / "fly.py").touch()
    made = []
    for north in (1.0, 2.0):
        (tmp_path / "hover.smoke.yaml").write_text(
            "arena:\n  defaults: {autopilot: builtin}\n  vehicles:\n"
            f"    uav1: {{program: fly.py, start: {{position: [{north}, 0, 0]}}}}\n"
            "steps:\n  - expect: uav1.landed within 60 s\n"
        )
        (scenario,) = load_scenarios(str(tmp_path / "hover.smoke.yaml"))
        folder = tmp_path / slug(scenario.name)
        folder.mkdir(exist_ok=True)
        made.append(launch_options(scenario, folder, options).arena)
    assert made[0].parent == made[1].parent
    assert [load_arena(file).vehicles[0].position[0] for file in made] == [1.0, 2.0]


def test_arena_file_of_a_scenario_is_deleted_after_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    started = []

    def fails(self: Session) -> Session:
        started.append(self._options.arena)
        assert started[0].is_file()
        raise RunError("not started")

    monkeypatch.setattr(Session, "__enter__", fails)
    (tmp_path / "fly.py").touch()
    (tmp_path / "hover.smoke.yaml").write_text(
        "arena:\n  defaults: {autopilot: builtin}\n  vehicles:\n    uav1: {program: fly.py}\n"
        "steps:\n  - expect: uav1.landed within 60 s\n"
    )
    (scenario,) = load_scenarios(str(tmp_path / "hover.smoke.yaml"))
    assert not fly(scenario, FlightOptions(results=tmp_path / "results")).verdict.passed
    assert len(started) == 1 and not started[0].exists()


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
