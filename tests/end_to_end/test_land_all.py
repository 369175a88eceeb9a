"""The panic path, with its helpers stopped or killed."""

from __future__ import annotations

import os
import signal

import pytest

from .flight import Flight, Hangar, eventually

pytestmark = pytest.mark.flight
VEHICLES = {"uav1": "hovers", "uav2": "hovers"}


def assert_all_landed(flight: Flight, *arguments: str) -> None:
    """`arena land-all` exits 0 with a line for each vehicle, and the truth agrees."""
    told = flight.cli("land-all", *arguments)
    print(told.stdout)
    assert told.returncode == 0, told.stdout + told.stderr
    flight.until_down(1)
    assert (flight.truth().motors < 1e-3).all()
    for vehicle in VEHICLES:
        assert [x for x in told.stdout.splitlines() if x.startswith(f"{vehicle}: landed and disarmed after")]


def test_it_lands_all_while_the_supervisor_is_stopped(hangar: Hangar) -> None:
    flight = hangar.fly(VEHICLES)
    flight.until_up(0.9)
    flight.signal(signal.SIGSTOP)
    try:
        assert_all_landed(flight)
    finally:
        flight.signal(signal.SIGCONT)

    flight.until_event("program.uav1", "EXITED", 10)
    flight.until_event("program.uav2", "EXITED", 10)
    assert "left OFFBOARD and is now in AUTO.LAND" in flight.log("program.uav1")
    assert flight.cli("down").returncode == 1  # both programs lost their vehicle
    assert flight.wait() == 1
    for vehicle in VEHICLES:
        assert flight.verdict(vehicle)["crashed"] == "" and flight.verdict(vehicle)["touchdown_m_s"] < 1.5
    flight.assert_nothing_left()


def test_it_lands_all_with_the_router_killed_and_nobody_to_start_it_again(hangar: Hangar) -> None:
    flight = hangar.fly(VEHICLES)
    flight.until_up(0.9)
    router = flight.pid("router")
    flight.signal(signal.SIGSTOP)
    os.kill(router, signal.SIGKILL)
    try:
        assert_all_landed(flight, "--run", str(flight.folder))
    finally:
        flight.signal(signal.SIGCONT)

    flight.until_event("router", "READY", 15, times=2)
    eventually(lambda: flight.fact("uav1.armed") is False and flight.fact("uav2.armed") is False, 10, "facts of the new router")
    assert flight.cli("down").returncode == 1
    assert flight.wait() == 1
    assert flight.outcome["processes"]["router"]["starts"] == 2
    assert flight.outcome["landing"] == "nothing was flying"
    flight.assert_nothing_left()


def test_a_hung_router_keeps_neither_the_panic_path_nor_the_end_from_landing(hangar: Hangar) -> None:
    flight = hangar.fly(VEHICLES)
    flight.until_up(0.9)
    os.kill(flight.pid("router"), signal.SIGSTOP)
    assert_all_landed(flight)
    flight.signal(signal.SIGINT)
    assert flight.wait() == 130
    assert flight.outcome["landing"] == "landed and disarmed"
    flight.assert_nothing_left()
