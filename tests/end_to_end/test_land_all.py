"""Tests of `land-all` with other processes stopped or killed, one by one and all together."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence

import pytest

from .flight import Flight, Hangar, eventually

pytestmark = pytest.mark.flight
VEHICLES = {"uav1": "hovers", "uav2": "hovers"}
HELPERS = ("supervisor", "router", "mocap", "copilot")
# PX4 binds its ports on every address, so these ids are ones that other arenas rarely have.
IDS = ("--set", "vehicles.uav1.id=61", "--set", "vehicles.uav2.id=62")


def hit(flight: Flight, names: Sequence[str], number: int) -> None:
    """Signal the named processes, the supervisor first because it would restart the others; skip missing ones."""
    state = flight.state
    for name in names:
        member = state.supervisor if name == "supervisor" else state.processes.get(name)
        assert member is not None or number == signal.SIGCONT
        if member is not None and member.alive:
            os.kill(member.pid, number)


def assert_told(said: str, words: tuple[str, ...] = ("landed and disarmed after",)) -> None:
    for vehicle in VEHICLES:
        starts = tuple(f"{vehicle}: {each}" for each in words)
        assert [x for x in said.splitlines() if x.startswith(starts)], said


def assert_all_landed(flight: Flight, *arguments: str, copilot: bool = False) -> None:
    """Check that `arena land-all` exits 0 with a line per vehicle, and that the truth agrees.

    copilot: a running copilot may have landed the vehicles before a slow machine has started the command.
    """
    told = flight.cli("land-all", *arguments, limit_s=90.0)
    print(told.stdout)
    assert told.returncode == 0, told.stdout + told.stderr
    by_copilot = ("already on the ground",) if copilot else ()
    assert_told(told.stdout, ("landed and disarmed after", *by_copilot))
    assert_down(flight)


def assert_down(flight: Flight) -> None:
    flight.until_down(1)

    def rotors_stand() -> bool:
        return bool((flight.truth().motors < 1e-3).all())

    eventually(rotors_stand, 2, "the rotors run down")


# Flown at every `make test`; `make nightly` flies all combinations.
DAILY = {
    ("supervisor", signal.SIGSTOP),
    ("router", signal.SIGSTOP),
    ("router", signal.SIGKILL),
    ("all", signal.SIGSTOP),
    ("all", signal.SIGKILL),
}
CASES = [
    pytest.param(
        names,
        number,
        id=f"{number.name}-{what}",
        marks=[] if (what, number) in DAILY else pytest.mark.nightly,
    )
    for number in (signal.SIGSTOP, signal.SIGKILL)
    for what, names in (*((name, (name,)) for name in HELPERS), ("all", HELPERS))
]


# One arena per case. Stopped processes are continued afterwards, so that the run records how the flight ended.
@pytest.mark.parametrize(("names", "number"), CASES)
def test_land_all_works_without_other_processes(
    hangar: Hangar, names: tuple[str, ...], number: signal.Signals
) -> None:
    flight = hangar.fly(VEHICLES, *IDS, more="copilot: {}\n")
    flight.until_up(0.9)
    hit(flight, names, number)
    try:
        assert_all_landed(flight, copilot="copilot" not in names)
    finally:
        if number == signal.SIGSTOP:
            hit(flight, names, signal.SIGCONT)
    told = flight.cli("down", limit_s=90.0)
    assert told.returncode in (0, 1), (
        told.stdout + told.stderr
    )  # programs lost their vehicle; a stale run has no verdict
    flight.wait()
    flight.assert_nothing_left()


def test_two_land_alls_confirm_and_ctrl_c_ends_a_hung_router(hangar: Hangar) -> None:
    flight = hangar.fly(VEHICLES, *IDS)
    flight.until_up(0.9)
    hit(flight, ("supervisor", "router"), signal.SIGSTOP)
    try:
        both = [flight.start_cli("land-all") for _ in range(2)]
        said = [process.communicate(timeout=270)[0] for process in both]
        assert [process.returncode for process in both] == [0, 0], said
        for words in said:
            assert "uav1: " in words and "uav2: " in words and "NOT CONFIRMED" not in words
        assert_told(said[0] + said[1])
        assert_down(flight)
    finally:
        hit(flight, ("supervisor",), signal.SIGCONT)
    flight.signal(signal.SIGINT)
    assert flight.wait() == 130
    assert flight.outcome["landing"] in (
        "landed and disarmed",
        "no vehicle had to be landed",
    )  # a new router may have told by then
    flight.assert_nothing_left()


def test_land_all_lands_softly_by_the_running_plan(hangar: Hangar) -> None:
    flight = hangar.fly(VEHICLES, *IDS, "--speed", "10")
    flight.until_up(0.9)
    file = hangar.folder / "arena.yaml"
    file.write_text("address: 127.66.99.9\nvehicles: {somebody: {id: 40}}\n")
    assert_all_landed(flight, str(file))  # not as the edited YAML says
    flight.until_event("program.uav1", "EXITED", 10)
    flight.until_event("program.uav2", "EXITED", 10)
    assert "left OFFBOARD and is now in AUTO.LAND" in flight.log("program.uav1")
    eventually(
        lambda: flight.fact("uav1.armed") is False and flight.fact("uav2.armed") is False,
        10,
        "facts of the router",
    )
    assert flight.cli("down").returncode == 1  # both programs lost their vehicle
    assert flight.wait() == 1
    assert flight.outcome["landing"] == "no vehicle had to be landed"
    for vehicle in VEHICLES:
        assert flight.verdict(vehicle)["crashed"] == "" and flight.verdict(vehicle)["touchdown_m_s"] < 1.5
    flight.assert_nothing_left()
