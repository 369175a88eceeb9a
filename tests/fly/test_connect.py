"""End of a session: it lands the vehicle only if the session itself flies it."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from arena.clock_server import ClockServer
from arena.errors import RunError, StaleDataError
from arena.fly.connect import FollowedClock, Session
from arena.uav import UAV


class Vehicle:
    """Stand-in for `UAV`. flies: whether the vehicle follows its setpoints."""

    def __init__(self, *, armed: bool, flies: bool, mode: str = "OFFBOARD") -> None:
        self.info = SimpleNamespace(is_armed=armed, flight_mode=mode)
        self.control = SimpleNamespace(flies=lambda offboard_loss_s: flies and offboard_loss_s == 2.5)
        self.clock: object = None
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
    server.poll()
    assert clock.now() == 1.0 and clock.sleep_until(0.9) == 1.0 and not clock.has_ended
    assert server.may_advance(1.0, 0.0) and not (server.joined or server.asleep or server.dropped)
    server.close()
    with pytest.raises(RunError, match="the simulated world has ended"):
        clock.now()
    with pytest.raises(RunError, match="the simulated world has ended"):
        clock.sleep_until(2.0)


def ended_world(tmp_path: Path) -> FollowedClock:
    server = ClockServer(tmp_path / "clock", lockstep=True)
    clock = FollowedClock(str(tmp_path / "clock"))
    server.close()
    return clock


class Failing(Vehicle):
    """Its values raise the errors of a list, one after the other."""

    def __init__(self, clock: object, *errors: Exception) -> None:
        super().__init__(armed=True, flies=True)
        self.clock, self.errors = clock, list(errors)

    @property
    def info(self) -> object:
        if self.errors:
            raise self.errors.pop(0)
        return self._info

    @info.setter
    def info(self, value: object) -> None:
        self._info = value


def test_session_whose_world_has_ended_says_so(tmp_path: Path) -> None:
    uav = Failing(ended_world(tmp_path), RunError("the world has ended"))
    uav.errors *= 2
    assert said_at_the_end(uav) == ["uav1: the simulated world has ended"]
    assert uav.done == ["close"]


def test_error_of_the_receiving_thread_does_not_keep_a_session_from_landing() -> None:
    uav = Failing(None, RunError("received data could not be processed"))
    said_at_the_end(uav)
    assert uav.done == ["land", "close"]
    again = Failing(None, *[RunError("received data could not be processed")] * 2)
    assert "LANDING NOT CONFIRMED: received data" in said_at_the_end(again)[0]


def test_connection_of_a_session_names_the_end_of_the_world(tmp_path: Path) -> None:
    uav = UAV(
        *("uav1", 1.5, 0.3, 0.1, 4, {"kind": "quadratic", "a": 34.068, "b": 7.1202, "fade_speed_m_s": 25.0}),
        link="udpin:127.58.77.1:16001",
        system_id=1,
        clock=ended_world(tmp_path),
    )
    try:
        assert not uav.info.is_connected
        time.sleep(0.05)  # the thread that receives meets the end, too
        with pytest.raises(RunError, match=r"^the simulated world has ended"):
            _ = uav.info.is_armed
    finally:
        uav.close()
