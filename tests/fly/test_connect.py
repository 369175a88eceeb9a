"""End of a session: it lands the vehicle only if the session itself flies it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from arena.errors import StaleDataError
from arena.fly.connect import Session


class Vehicle:
    """Stand-in for `UAV`. flies: whether the vehicle follows its setpoints."""

    def __init__(self, *, armed: bool, flies: bool) -> None:
        self.info = SimpleNamespace(is_armed=armed, flight_mode="OFFBOARD")
        self.control = SimpleNamespace(flies=lambda offboard_loss_s: flies and offboard_loss_s == 2.5)
        self.done: list[str] = []

    def auto_land(self) -> None:
        self.done.append("land")

    def close(self) -> None:
        self.done.append("close")


def ended(uav: Vehicle) -> list[str]:
    session = Session.__new__(Session)
    session.uav = uav
    session.vehicle = SimpleNamespace(name="uav1", settings=SimpleNamespace(offboard_loss_s=2.5))
    session.end(say=lambda text: None)
    return uav.done


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

    assert ended(Silent(armed=True, flies=True)) == ["close"]
