"""Tests of Ctrl-C, SIGTERM and SIGHUP in flight: land, then stop."""

from __future__ import annotations

import itertools
import signal
from typing import Any

import pytest

from .flight import Flight, Hangar, eventually

pytestmark = pytest.mark.flight
COLD = True  # as a user starts it: in a new interpreter


def assert_landed_softly(flight: Flight, vehicle: str) -> None:
    verdict: dict[str, Any] = flight.verdict(vehicle)
    assert verdict["crashed"] == "" and not verdict["airborne"]
    assert verdict["landings"] == 1 and verdict["touchdown_m_s"] < 1.5 and verdict["max_tilt_deg"] < 30
    assert flight.summary["vehicles"][vehicle]["landing"]["landed"]
    assert flight.summary["landing"] == "landed and disarmed"
    told = [event["mono"] for event in flight.events()]
    assert all(
        after > before - 2.0 for before, after in itertools.pairwise(told)
    )  # in the order in which it happened, but for one slow round of the loop


@pytest.mark.parametrize(
    ("number", "code", "cause"),
    [
        (signal.SIGINT, 130, "Ctrl-C"),
        (signal.SIGTERM, 0, "SIGTERM"),
        (signal.SIGHUP, 0, "SIGHUP"),
    ],
)
def test_signal_in_flight_lands_then_stops(hangar: Hangar, number: int, code: int, cause: str) -> None:
    flight = hangar.fly({"uav1": "hovers"}, "--speed", "3", "--processes")
    flight.until_up(0.9)
    flight.signal(number)
    assert flight.wait() == code, flight.said()
    assert flight.summary["cause"] == cause
    assert_landed_softly(flight, "uav1")
    assert "left OFFBOARD and is now in AUTO.LAND" in flight.log("program.uav1")
    flight.assert_nothing_left()


def test_repeated_ctrl_c_never_disarms_in_flight(hangar: Hangar) -> None:
    flight = hangar.fly({"uav1": "spins", "uav2": "hovers"})
    flight.until_up(0.9)
    flight.signal(signal.SIGINT)
    flight.until_said("landing, then stopping", 5)
    for _ in range(5):
        flight.signal(signal.SIGINT)
        eventually(lambda: flight.heights().min() > 0.0, 1, "still in the air")
    flight.until_said("programs are killed; processes that serve a vehicle continue", 5)
    assert flight.wait() == 130, flight.said()
    for vehicle in ("uav1", "uav2"):
        assert_landed_softly(flight, vehicle)
    flight.assert_nothing_left()
