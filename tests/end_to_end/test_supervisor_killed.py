"""Tests of a supervisor killed in flight: programs end, vehicles land by themselves, no process remains."""

from __future__ import annotations

import signal

import psutil
import pytest

from .flight import Hangar, eventually

pytestmark = pytest.mark.flight
VEHICLES = {"uav1": "hovers", "uav2": "hovers"}


def test_arena_without_supervisor_lands_and_ends(hangar: Hangar) -> None:
    flight = hangar.fly(VEHICLES, "--speed", "3", "--processes")
    flight.until_up(0.9)
    programs = [flight.pid(f"program.{v}") for v in VEHICLES]
    world = flight.pid("world")
    flight.signal(signal.SIGKILL)
    assert flight.wait() == -signal.SIGKILL

    eventually(lambda: not any(map(psutil.pid_exists, programs)), 2, "the programs' end")
    flight.until_down(20)
    assert psutil.pid_exists(world)  # what serves a vehicle outlives its landing
    eventually(
        lambda: not flight.processes(), 50, "the end of every process"
    )  # after disarming, not by the limit of 60 s
    assert flight.sockets() == []
    for vehicle in VEHICLES:
        rows = flight.rows(vehicle)
        assert (rows[-1]["info.is_armed"], rows[-1]["info.is_landed"]) == ("False", "True")
        assert max(float(r["truth.vel.down"]) for r in rows) < 1.5

    again = hangar.fly({"uav1": "lands"}, "--until-done", "--speed", "max")
    assert again.wait() == 0, again.said()
    assert again.summary["vehicles"]["uav1"]["landing"]["landed"]
    again.assert_nothing_left()


def test_next_start_lands_and_cleans_up_an_orphaned_arena(hangar: Hangar) -> None:
    flight = hangar.fly({"uav1": "hovers"})
    flight.until_up(0.9)
    world = psutil.Process(flight.pid("world"))
    world.suspend()  # it would land and end by itself, before a slow machine has started the next
    flight.signal(signal.SIGKILL)
    flight.wait()

    again = hangar.fly({"uav1": "lands"}, "--until-done", "--speed", "max")
    again.until_said("the supervisor of", 30)
    world.resume()
    assert again.wait(90) == 0, again.said()
    assert "the supervisor of" in again.said() and "uav1: landed and disarmed" in again.said()
    assert max(float(r["truth.vel.down"]) for r in flight.rows("uav1")) < 1.5
    assert flight.processes() == set()
    again.assert_nothing_left()
