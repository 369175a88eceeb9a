"""Authority over a flying vehicle, in whole arenas: no program undoes land-all, also not a restarted one."""

from __future__ import annotations

import pytest

from .flight import Flight, Hangar, eventually

pytestmark = pytest.mark.flight


def restart_program(flight: Flight) -> None:
    told = flight.cli("restart", "program.uav1", "--yes")
    assert told.returncode == 0, told.stderr


def test_restarted_program_flies_again_only_after_release(hangar: Hangar) -> None:  # review fault 9
    flight = hangar.fly({"uav1": "hovers"})
    flight.until_up(0.5)
    nothing = flight.cli("release", "uav1")
    assert nothing.returncode == 1 and "uav1: nothing to release: program has control" in nothing.stderr
    assert flight.cli("land-all", limit_s=90.0).returncode == 0
    flight.until_said("uav1: land-all has control: landing, until `arena release`", 10)
    flight.until_event("program.uav1", "EXITED", 30)  # it lost its vehicle

    restart_program(flight)
    flight.until_event("program.uav1", "EXITED", 60, times=2)
    assert "land-all has control: run `arena release`" in flight.log("program.uav1")
    assert flight.fact("uav1.armed") is False

    assert flight.cli("release", "uav1").returncode == 0
    eventually(lambda: flight.fact("uav1.blocked") == "", 10, "released", flight.said)
    restart_program(flight)
    flight.until_up(0.5)
    assert flight.cli("down", limit_s=90.0).returncode in (0, 1)
    flight.wait()
    flight.assert_nothing_left()
