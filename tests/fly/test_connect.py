"""End of a session: it lands the vehicle only if the session itself flies it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from arena.errors import RunError, StaleDataError
from arena.fly.connect import Session


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
