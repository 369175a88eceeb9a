"""`arena fly VEHICLE FILE` after an error: it lands its vehicle, and commands no vehicle that somebody else flies."""

from __future__ import annotations

from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import pytest

from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, RunError
from arena.fly import follow_file
from arena.fly.follow_file import fly_file, land_after_error

VEHICLE: Any = SimpleNamespace(settings=SimpleNamespace(offboard_loss_s=1.0))


def uav_that(*, flies: bool, armed: bool, mode: str = "OFFBOARD") -> tuple[Any, list[str]]:
    """Return a vehicle and the list of its landings. flies: it follows the setpoints of this program."""
    landings: list[str] = []
    info = SimpleNamespace(is_armed=armed, flight_mode=mode)
    control = SimpleNamespace(flies=lambda offboard_loss_s: flies)
    return SimpleNamespace(info=info, control=control, auto_land=lambda: landings.append("landed")), landings


def test_vehicle_that_this_program_flies_is_landed() -> None:
    uav, landings = uav_that(flies=True, armed=True)
    assert land_after_error(uav, VEHICLE, print, EXIT_INTERRUPTED) == EXIT_INTERRUPTED
    assert landings == ["landed"]


@pytest.mark.parametrize("mode", ["OFFBOARD", "POSCTL", "AUTO.LAND"])
def test_vehicle_that_another_sender_flies_gets_no_command(
    mode: str, capsys: pytest.CaptureFixture[str]
) -> None:
    uav, landings = uav_that(flies=False, armed=True, mode=mode)
    assert land_after_error(uav, VEHICLE, print, EXIT_INTERRUPTED) == EXIT_INTERRUPTED
    assert landings == [] and f"still armed, in {mode}" in capsys.readouterr().out


def test_disarmed_vehicle_gets_no_command() -> None:
    uav, landings = uav_that(flies=False, armed=False)
    assert land_after_error(uav, VEHICLE, print) == EXIT_FAILED and landings == []


def test_vehicle_is_landed_after_data_that_could_not_be_processed(monkeypatch: pytest.MonkeyPatch) -> None:
    uav, landings = uav_that(flies=True, armed=True)

    def fly(*_: Any) -> None:
        raise RunError("received data could not be processed")

    vehicle: Any = SimpleNamespace(name="uav1", settings=VEHICLE.settings)
    for name in ("check_authority", "check_flight"):
        monkeypatch.setattr(follow_file, name, lambda *_: None)
    monkeypatch.setattr(follow_file, "lock_pilot", lambda _: SimpleNamespace(close=lambda: None))
    monkeypatch.setattr(follow_file, "open_uav", lambda _, lockstep: nullcontext(uav))
    monkeypatch.setattr(follow_file, "_fly", fly)
    trajectory: Any = None
    assert fly_file(vehicle, trajectory, print) == EXIT_FAILED
    assert landings == ["landed"]
