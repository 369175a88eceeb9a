"""End of a session: it lands the vehicle only if the session itself flies it."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from arena.clock import ClockServer
from arena.errors import RunError, StaleDataError
from arena.fly.connect import FollowedClock, Session


class Vehicle:
    """Stand-in for `UAV`. flies: whether the vehicle follows its setpoints."""

    def __init__(self, *, armed: bool, flies: bool, mode: str = "OFFBOARD") -> None:
        self.info = SimpleNamespace(is_armed=armed, flight_mode=mode)
        self.control = SimpleNamespace(flies=lambda offboard_loss_s: flies and offboard_loss_s == 2.5)
        self.done: list[str] = []

    def auto_land(self) -> None:
        self.done.append("land")

    def close(self) -> None:
        self.done.append("close")


def said_at_the_end(uav: Vehicle, control: str | None = "") -> list[str]:
    """control: who commands the vehicle, as the supervisor reports it; None if it does not reply"""

    def facts() -> dict[str, str]:
        if control is None:
            raise RunError("no arena replies")
        return {"control": control}

    session, said = Session.__new__(Session), []
    session.uav = uav
    session.vehicle = SimpleNamespace(name="uav1", settings=SimpleNamespace(offboard_loss_s=2.5), facts=facts)
    session.end(say=said.append)
    return said


def ended(uav: Vehicle) -> list[str]:
    said_at_the_end(uav)
    return uav.done


@pytest.mark.parametrize(
    ("mode", "control", "words"),
    [
        ("OFFBOARD", "program", "armed in OFFBOARD, and another program has control"),
        ("OFFBOARD", "", "armed in OFFBOARD, and another program has control"),
        ("POSCTL", "pilot", "armed in POSCTL, and pilot has control"),
        ("AUTO.LOITER", "", "armed in AUTO.LOITER, and nobody has control"),
        ("AUTO.LAND", None, "armed in AUTO.LAND, and the arena does not reply"),
    ],
)
def test_vehicle_that_is_left_in_the_air_is_named(mode: str, control: str | None, words: str) -> None:
    said = said_at_the_end(Vehicle(armed=True, flies=False, mode=mode), control)
    assert said == [f"uav1: NOT LANDED by this shell: {words}"]


def test_nothing_is_said_about_a_disarmed_vehicle() -> None:
    assert said_at_the_end(Vehicle(armed=False, flies=False)) == []


@pytest.mark.parametrize(
    ("armed", "flies", "done"),
    [(True, True, ["land", "close"]), (True, False, ["close"]), (False, False, ["close"])],
)
def test_session_lands_only_what_it_flies(armed: bool, flies: bool, done: list[str]) -> None:
    assert ended(Vehicle(armed=armed, flies=flies)) == done


def test_session_without_telemetry_is_closed_without_a_command() -> None:
    class Silent(Vehicle):
        @property
        def info(self) -> object:
            raise StaleDataError("no heartbeat")

        @info.setter
        def info(self, value: object) -> None:
            pass

    uav = Silent(armed=True, flies=True)
    assert said_at_the_end(uav) == [
        "uav1: NOT LANDED by this shell: state not known (no heartbeat). Use `arena land-all`"
    ]
    assert uav.done == ["close"]


def test_clock_of_a_session_ends_with_the_world_and_never_holds_it(tmp_path: Path) -> None:
    """Otherwise the last position would stay fresh for ever, and a sleep would never end."""
    server = ClockServer(tmp_path / "clock", lockstep=True)
    clock = FollowedClock(str(tmp_path / "clock"))
    server.tick(1.0)
    assert clock.now() == 1.0 and clock.sleep_until(0.9) == 1.0
    assert server.may_advance(1.0, 0.0)
    server.close()
    with pytest.raises(RunError, match="the world"):
        clock.now()
    with pytest.raises(RunError, match="the world"):
        clock.sleep_until(2.0)


def test_session_whose_world_has_ended_says_so() -> None:
    class Ended(Vehicle):
        @property
        def info(self) -> object:
            raise RunError("the world has ended")

        @info.setter
        def info(self, value: object) -> None:
            pass

    uav = Ended(armed=True, flies=True)
    assert "state not known (the world has ended)" in said_at_the_end(uav)[0]
    assert uav.done == ["close"]
