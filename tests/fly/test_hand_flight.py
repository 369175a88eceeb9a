"""Flight by hand with keys: the built-in autopilot in the simulated world, without processes and sockets."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import Autopilots
from arena.errors import EXIT_FAILED, EXIT_OK, InputError
from arena.fly.by_hand import HandFlight, fly_by_hand
from arena.fly.pilot import Pilot
from arena.fly.running_vehicle import RunningVehicle
from arena.wire.sticks import CENTRED, Sticks

sys.path.insert(0, str(Path(__file__).parents[1] / "autopilot"))
from flight import Flight

PARAMS = {"COM_RC_IN_MODE": 1, "NAV_RCL_ACT": 3, "COM_RCL_EXCEPT": 7}


class FakeGamepad:
    def __init__(self) -> None:
        self.sticks: Sticks | None = CENTRED
        self.actions: list[str] = []

    def poll(self):
        actions, self.actions = self.actions, []
        return self.sticks, actions


class Room:
    """A simulated vehicle with authority, a person at the keys, and perhaps a gamepad."""

    def __init__(self, gamepad: FakeGamepad | None = None, **params: float) -> None:
        self.world = Flight(params={**PARAMS, **params})
        self.world.pilots = Autopilots(self.world.settings, self.world.world.period_s, authority=True)
        self.lines: list[str] = []
        self.pilot = Pilot("uav1", 1)
        self.hand = HandFlight(self.pilot, self._send, self.lines.append, gamepad)
        transmit = self.world.pilots.transmit

        def tee():
            sent = transmit()
            for _, link, data in sent:
                if link == "router":
                    self.pilot.on_datagram(data, self.world.now)
            return sent

        self.world.pilots.transmit = tee
        self.keys = b""
        self.run(3.0, fly=False)

    def _send(self, frame: bytes) -> None:
        self.world.pilots.receive(0, "router", frame)

    def tick(self, f) -> None:
        if self.keys:
            self.hand.on_keys(self.keys, f.now)
        self.hand.tick(f.now)

    def run(self, seconds: float, keys: bytes = b"", *, fly: bool = True) -> Room:
        """Let the person hold keys for some seconds. fly: the loop of `arena fly` runs"""
        self.keys = keys
        self.world.run(seconds, self.tick if fly else None)
        self.keys = b""
        return self

    def press(self, key: bytes) -> Room:
        self.hand.on_keys(key, self.world.now)
        return self.run(1.2)

    @property
    def mode(self) -> str:
        return self.world.mode(0)

    @property
    def height(self) -> float:
        return -float(self.world.position(0)[2])

    def take_off(self) -> Room:
        self.press(b"1").press(b"r").run(2.0)
        self.run(6.0, b"w").run(2.0)
        assert self.mode == "POSCTL" and self.height > 0.7
        return self


def test_person_takes_off_flies_right_holds_and_lands_with_keys():
    room = Room().take_off()
    east = room.world.position(0)[1]
    room.run(2.0, b"\x1b[C")
    assert room.world.position(0)[1] > east + 0.5
    room.run(3.0)
    stopped = room.world.position(0).copy()
    room.run(2.0)
    assert abs(room.world.position(0) - stopped).max() < 0.1
    room.press(b"q")
    assert room.mode == "AUTO.LAND"
    room.world.until(lambda f: room.hand.result is not None, 15.0, room.tick)
    assert room.hand.result == EXIT_OK and not room.world.armed(0) and room.height < 0.1


def test_status_line_shows_mode_height_and_battery():
    room = Room().take_off()
    assert "POSCTL" in room.lines[-1] and "armed" in room.lines[-1] and "battery" in room.lines[-1]
    assert f"{room.height:.1f}"[:2] in room.lines[-1]


def test_killed_process_leaves_the_vehicle_to_its_failsafe():
    room = Room().take_off()
    room.run(1.0, fly=False)
    assert room.mode == "AUTO.LAND"


def test_lost_terminal_ends_the_sticks_without_a_command():
    room = Room().take_off()
    room.hand.on_keys(b"", room.world.now)
    assert room.hand.result == EXIT_FAILED and not room.pilot.is_busy


def test_lost_gamepad_sends_no_stick_positions():
    gamepad = FakeGamepad()
    room = Room(gamepad)
    gamepad.actions = ["POSCTL"]
    room.run(1.0)
    gamepad.actions = ["arm"]
    room.run(2.5)
    gamepad.sticks = Sticks(throttle=0.8)
    room.run(5.0)
    gamepad.sticks = CENTRED
    room.run(2.0)
    assert room.mode == "POSCTL" and room.height > 1.0
    gamepad.sticks = None
    room.run(1.0)
    assert room.mode == "AUTO.LAND" and "GAMEPAD LOST" in room.lines[-1]


def test_keys_do_not_end_the_landing_after_quit():
    room = Room().take_off()
    room.press(b"q")
    room.run(1.0, b"\x1b[A")
    assert room.mode == "AUTO.LAND"


def test_second_quit_leaves_at_once():
    room = Room().take_off()
    room.press(b"q")
    room.hand.interrupt(room.world.now)
    assert room.hand.result == EXIT_FAILED


def test_vehicle_of_a_program_is_not_landed_by_quit():
    room = Room()
    room.hand.on_keys(b"q", room.world.now)
    assert room.hand.result == EXIT_OK
    room = Room()
    room.world.run(0.3, lambda f: f.setpoint(0, (0.0, 0.0, -1.0)))
    assert (
        room.world.offboard(0) == mavlink.MAV_RESULT_ACCEPTED
        and room.world.arm(0) == mavlink.MAV_RESULT_ACCEPTED
    )

    def program(f):
        f.setpoint(0, (0.0, 0.0, -1.0))
        room.tick(f)

    room.world.run(4.0, program)
    assert room.mode == "OFFBOARD", "centred sticks take nothing"
    room.hand.on_keys(b"q", room.world.now)
    assert room.hand.result == EXIT_OK and not room.pilot.is_busy


def test_person_takes_the_vehicle_from_a_program_and_keeps_it():
    room = Room()
    room.world.run(0.3, lambda f: f.setpoint(0, (0.0, 0.0, -1.0)))
    room.world.offboard(0)
    room.world.arm(0)

    def program(f):
        f.setpoint(0, (0.0, 0.0, -1.0))
        room.tick(f)

    room.world.run(4.0, program)
    room.hand.on_keys(b"1", room.world.now)
    room.world.run(1.0, program)
    assert room.mode == "POSCTL"
    assert room.world.offboard(0) == mavlink.MAV_RESULT_DENIED
    room.world.run(1.0, program)
    assert room.mode == "POSCTL"
    room.hand.on_keys(b"o", room.world.now)
    room.world.run(1.0, program)
    assert room.mode == "OFFBOARD", "the person gives the vehicle back"


def test_refused_mode_is_shown_with_its_reason():
    room = Room()
    room.world.vision_on[0] = False
    room.run(2.5)
    room.press(b"3").press(b"r")
    assert "refused" in room.lines[-1]


def test_ended_arena_ends_the_flight_by_hand():
    room = Room()
    room.hand.tick(room.world.now)
    room.hand.tick(room.world.now + 20.0)
    assert room.hand.result == EXIT_FAILED and "lost" in room.lines[-1]


@pytest.mark.parametrize(
    ("mode", "problem"), [(0, "RC transmitter"), (1, ""), (2, ""), (3, ""), (4, "no sticks")]
)
def test_vehicle_that_ignores_joysticks_is_not_flown(mode, problem):
    room = Room(COM_RC_IN_MODE=mode)
    room.world.pilots.receive(0, "router", room.pilot.source_request())
    room.world.run(0.1)
    assert room.pilot.source == mode
    assert (problem in room.pilot.source_problem()) if problem else room.pilot.source_problem() == ""


@pytest.mark.parametrize(("speed", "refused"), [("max", True), (2.0, True), (1.0, False), (0.5, False)])
def test_a_simulation_faster_than_real_time_is_refused(
    speed: float | str, refused: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "slices").mkdir()
    (tmp_path / "slices" / "world.json").write_text(json.dumps({"speed": speed}))
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    vehicle = RunningVehicle(
        run=SimpleNamespace(run=str(tmp_path), rt=str(tmp_path / "missing")),
        room=None,
        settings=SimpleNamespace(name="uav1", id=1, kind="built-in", tools=("127.0.0.1", 1)),
        program_file=tmp_path,
    )
    # an arena that is not refused has no runtime folder here, so its vehicle cannot be locked
    with pytest.raises(InputError if refused else FileNotFoundError):
        fly_by_hand(vehicle)
