"""Tests of the copilot in whole arenas: a hung SDK program, loss of the copilot, and a correct flight.

Flights that crash without the copilot and not with it are scenarios (`examples/08_copilot`).
"""

from __future__ import annotations

import os
import signal

import pytest

from .flight import PROGRAMS, Flight, Hangar, eventually

pytestmark = pytest.mark.flight

FIRST_ID = 65
"""PX4 binds its ports on every address; other arenas of this computer may use the low ids."""


def hung(hangar: Hangar, more: str, *options: str, program: str = "hung_sdk.py") -> Flight:
    vehicle = f"{{id: {FIRST_ID}, program: {PROGRAMS / program}}}"
    lines = [
        f"address: {hangar.address}",
        "defaults: {autopilot: builtin}",
        f"vehicles: {{uav1: {vehicle}}}",
        more,
    ]
    file = hangar.folder / "arena.yaml"
    file.write_text("\n".join(lines) + "\n")
    return hangar.up(file, *options)


@pytest.mark.parametrize(
    "program", [pytest.param("hung_sdk.py", marks=pytest.mark.nightly), "hung_mavsdk.py"]
)
def test_hung_sdk_program_is_landed_when_its_heartbeat_stops(hangar: Hangar, program: str) -> None:
    if "mavsdk" in program:
        pytest.importorskip("mavsdk.plugins.offboard", reason="mavsdk is not installed")
    flight = hung(hangar, "copilot: {}", program=program)
    flight.until_up()
    flight.until_disarmed(["uav1"], 60)
    (said,) = [e["event"] for e in flight.events("copilot") if "land: program" in e.get("event", "")]
    assert "no heartbeat of its program for" in said


def test_hung_sdk_program_hovers_without_a_copilot(hangar: Hangar) -> None:
    flight = hung(hangar, "", "--speed", "max", "--no-report")
    flight.until_up()
    eventually(lambda: "hangs" in flight.log("program.uav1"), 60, "the program hangs", flight.said)
    then = flight.truth().time_s
    eventually(lambda: flight.truth().time_s > then + 10.0, 120, "ten seconds more", flight.said)
    assert flight.fact("uav1.mode") == "OFFBOARD" and flight.fact("uav1.armed") is True


def touring(hangar: Hangar, copilot: str, *options: str) -> Flight:
    """Start two vehicles that fly a circle and land."""
    program = f"{{path: '{PROGRAMS / 'fly.py'}', args: [tours]}}"
    rows = [
        f"uav{k + 1}: {{id: {FIRST_ID + k}, start: {{position: [{2 * k}, 0, 0]}}, program: {program}}}"
        for k in (0, 1)
    ]
    lines = [
        f"address: {hangar.address}",
        "world: {size: [14, 6, 3]}",
        "defaults: {autopilot: builtin}",
        copilot,
    ]
    file = hangar.folder / "arena.yaml"
    file.write_text("\n".join([*lines, "vehicles:", *(f"  {row}" for row in rows)]) + "\n")
    return hangar.up(file, *options)


def bereft(
    hangar: Hangar, copilot: str, number: int = signal.SIGKILL, until: tuple[str, int] = ("EXITED", 1)
) -> Flight:
    """Return a flight in the air whose copilot was killed or stopped.

    until: state that the copilot must then reach, and how often.
    """
    flight = touring(hangar, copilot, "--until-done", "--speed", "3", "--processes")
    flight.until_up()
    state, times = until
    with flight.paced(0.5):  # the state is reached before the tour ends
        os.kill(flight.pid("copilot"), number)
        flight.until_event("copilot", state, 30, times)
    return flight


@pytest.mark.parametrize("number", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.nightly)])
def test_all_vehicles_land_when_the_copilot_is_lost(hangar: Hangar, number: int) -> None:
    flight = bereft(hangar, "copilot: {}", number, ("EXITED" if number == signal.SIGKILL else "FATAL", 1))
    assert flight.wait(120) == 1
    assert "copilot: killed by SIGKILL" in flight.said() or "copilot: paused" in flight.said()
    for name in ("uav1", "uav2"):
        assert flight.verdict(name)["crashed"] == "" and flight.verdict(name)["landings"] == 1
    flight.assert_nothing_left()


@pytest.mark.parametrize(
    ("on_loss", "starts"), [("restart", 2), pytest.param("warn", 1, marks=pytest.mark.nightly)]
)
def test_flight_continues_without_an_optional_copilot(hangar: Hangar, on_loss: str, starts: int) -> None:
    until = ("READY", 2) if on_loss == "restart" else ("EXITED", 1)
    flight = bereft(hangar, f"copilot: {{on_loss: {on_loss}}}", until=until)
    code = flight.wait(120)
    assert [e["to"] for e in flight.events("copilot") if "to" in e].count("READY") == starts
    assert all(flight.outcome["processes"][f"program.{n}"]["exit_code"] == 0 for n in ("uav1", "uav2"))
    assert code == (0 if on_loss == "restart" else 1)


def test_copilot_does_not_interfere_with_a_correct_flight(hangar: Hangar) -> None:
    flight = touring(hangar, "copilot: {}", "--until-done", "--speed", "max")
    assert flight.wait(240) == 0, flight.said()
    assert [e["event"] for e in flight.events("copilot") if "event" in e] == []
    stats = flight.stats("copilot")
    assert not any(key.startswith("sent") for key in stats) and stats["received program heartbeats"] > 10
    assert flight.json("slices/program.uav1.json")["heartbeat"] == [hangar.address, 24001]
