"""Tests of programs that fail or are slow, on both backends in the same flight: without the copilot, and with the copilot alone.

With the copilot, setpoints may be missing for longer than the copilot's limit for heartbeats. So only the copilot can land these vehicles.
"""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from .flight import PROGRAMS, Flight, Hangar

pytestmark = pytest.mark.flight

BACKENDS = ("mavlink", "mavsdk")
FAILING = {"hung": "waits", "frozen": "freezes", "killed": "is_killed", "thrower": "throws"}
SPINNING = {"spinner": "spins"}
"""Programs that hang with and without use of the CPU. MAVSDK's threads continue only without."""
LATE = {"late": "sends_at, '0.7'", "paused": "pauses, '1.5'"}
"""Programs with more than 1 s between two setpoints: their vehicles land."""
SLOW = {"slow": "sends_at, '2'"}
"""Programs with less than 1 s between two setpoints: they fly to their end."""


def both(kinds: dict[str, str]) -> dict[str, str]:
    """Return the vehicles of the kinds, one with each backend: name -> arguments of `programs/fly.py`."""
    return {f"{kind}_{backend}": args for backend in BACKENDS for kind, args in kinds.items()}


def names(kinds: Iterable[str]) -> list[str]:
    """Return the names of the vehicles of the kinds."""
    return list(both(dict.fromkeys(kinds, "")))


def fly(hangar: Hangar, kinds: dict[str, str], more: str = "") -> Flight:
    """Start a flight as fast as possible, with one vehicle of each kind and backend. more: further lines of the YAML."""
    pytest.importorskip("mavsdk.plugins.mavlink_direct", reason="mavsdk is not installed")
    lines = [
        f"address: {hangar.address}",
        "world: {size: [20, 8, 3]}",
        "defaults: {autopilot: builtin}",
        more,
    ]
    lines.append("vehicles:")
    for i, (name, args) in enumerate(both(kinds).items()):
        row, column = divmod(i, len(kinds))
        program = f"program: {{path: '{PROGRAMS / 'fly.py'}', args: [{args}]}}"
        at = f"start: {{position: [{2 * column - len(kinds) + 1}, {3 * row - 1.5}, 0]}}"
        lines.append(f"  {name}: {{backend: {BACKENDS[row]}, {at}, {program}}}")
    file = hangar.folder / "arena.yaml"
    file.write_text("\n".join(lines) + "\n")
    return hangar.up(file, "--speed", "max", "--until-done", "--time-limit", "300")


def exits(flight: Flight, kinds: dict[str, str]) -> dict[str, object]:
    programs = flight.outcome["processes"]
    return {name: programs[f"program.{name}"]["exit_code"] for name in both(kinds)}


def assert_landed_once(flight: Flight, kinds: dict[str, str]) -> None:
    for name in both(kinds):
        verdict = flight.verdict(name)
        assert verdict["crashed"] == "" and verdict["landings"] == 1, name


def test_late_programs_lose_the_vehicle_and_slow_ones_fly_on(hangar: Hangar) -> None:
    flight = fly(hangar, {**LATE, **SLOW})
    assert flight.wait(240) == 1
    assert exits(flight, LATE) == dict.fromkeys(both(LATE), 1)
    assert exits(flight, SLOW) == dict.fromkeys(both(SLOW), 0)
    for name in both(LATE):
        assert "failsafe of the autopilot (Failsafe activated: offboard control lost" in flight.log(
            f"program.{name}"
        )
    assert_landed_once(flight, {**LATE, **SLOW})
    flight.assert_nothing_left()


@pytest.mark.parametrize(
    ("after_s", "more"), [(5.0, {}), pytest.param(1.0, SPINNING, marks=pytest.mark.nightly)]
)
def test_copilot_lands_vehicles_whose_program_sends_no_heartbeat(
    hangar: Hangar, after_s: float, more: dict[str, str]
) -> None:
    """after_s: limit of the offboard failsafe [s]. At 1 s, as for the heartbeat, the failsafe or the copilot may be first."""
    failing = {**FAILING, **LATE, **more}
    flight = fly(
        hangar, {**failing, **SLOW}, f"copilot: {{}}\nfailsafe: {{offboard_loss: {{after_s: {after_s}}}}}"
    )
    flight.until_up()
    for name in both(SLOW):
        flight.until_event(f"program.{name}", "EXITED", 120)
    flight.until_disarmed(both(failing), 60)
    assert flight.cli("down", "--run", str(flight.folder)).returncode == 1 and flight.wait() == 1

    landed = {
        e["event"].partition(":")[0]
        for e in flight.events("copilot")
        if "land: program" in e.get("event", "")
    }
    if after_s > 1.0:
        assert landed == set(both(failing)) and "offboard control lost" not in flight.said()
    else:
        assert landed <= set(both(failing))
    assert exits(flight, LATE) == dict.fromkeys(both(LATE), 1)
    assert exits(flight, SLOW) == dict.fromkeys(both(SLOW), 0)
    assert_landed_once(flight, {**failing, **SLOW})
    flight.assert_nothing_left()
