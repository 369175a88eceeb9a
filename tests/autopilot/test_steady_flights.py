"""Vehicles that fly steadily decide less often. Each flight is flown twice, the second time with every decision, and must be the same."""

from __future__ import annotations

import hashlib
import math
import random
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from flight import Flight
from pymavlink.dialects.v20 import common as mavlink
from test_ulog_recorder import Memory

from arena.autopilot.commander import Commander
from arena.autopilot.steady_flights import SteadyFlights

Event = Callable[[Flight, int], None]
VEHICLES = 6
STEADY_S = 4.0  # after this time in the air the vehicles hover
SEEDS = range(2)


class Pilot:
    """Program that sends setpoints to all vehicles, 25 times a second.

    silent: vehicles that get none.  attitude: vehicles that get attitude setpoints
    acceleration_e: acceleration setpoint to the east instead of a position [m/s2], None for a position
    aside_m: distance by which all vehicles fly to the north of their start
    """

    def __init__(self) -> None:
        self.silent: set[int] = set()
        self.attitude: set[int] = set()
        self.acceleration_e: float | None = None
        self.aside_m = 0.0
        self._calls = 0

    def __call__(self, f: Flight) -> None:
        self._calls += 1
        for i in range(VEHICLES) if self._calls % 2 else ():
            if i in self.attitude:
                message = mavlink.MAVLink_set_attitude_target_message(
                    0, i + 1, 1, 0b111, [1, 0, 0, 0], 0, 0, 0, 0.563
                )
                f.send(i, message)
            elif self.acceleration_e is not None:
                vectors = (*[0] * 7, self.acceleration_e, 0)
                target = (0, i + 1, 1, 1, 0b110000111111, *vectors, 0, 0)
                f.send(i, mavlink.MAVLink_set_position_target_local_ned_message(*target))
            elif i not in self.silent:
                f.setpoint(i, (self.aside_m + 0.3 * math.sin(f.now), 2.0 * i, -1.5))


def send(command: int, *p: float, link: str = "router") -> Event:
    def event(f: Flight, i: int) -> None:
        args = (list(p) + [0.0] * 7)[:7]
        f.send(i, mavlink.MAVLink_command_long_message(i + 1, 1, command, 0, *args), link)

    return event


def set_param(name: str, value: float) -> Event:
    """Set a parameter; it must have the type of `value`."""
    encoded, kind = value, mavlink.MAV_PARAM_TYPE_REAL32
    if isinstance(value, int):
        (encoded,), kind = struct.unpack("<f", struct.pack("<i", value)), mavlink.MAV_PARAM_TYPE_INT32

    def event(f: Flight, i: int) -> None:
        f.send(i, mavlink.MAVLink_param_set_message(i + 1, 1, name.encode(), encoded, kind))

    return event


def heartbeat(f: Flight, i: int) -> None:
    f.send(i, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), "ground")


def sticks(f: Flight, i: int) -> None:
    f.send(i, mavlink.MAVLink_manual_control_message(i + 1, 700, 0, 500, 0, 0))


def flip(f: Flight, i: int) -> None:
    tilted = np.array([math.cos(0.7), math.sin(0.7), 0.0, 0.0])
    f.world.bodies.place(i, p_n=f.position(i), q_nb=tilted)


EVENTS: dict[str, Event] = {
    "vision ends": lambda f, i: f.vision_on.__setitem__(i, False),
    "vision begins": lambda f, i: f.vision_on.__setitem__(i, True),
    "vision jumps": lambda f, i: f.faults.__setitem__(i, lambda p, q: (p + np.array([3.0, 0.0, 0.0]), q)),
    "battery low": lambda f, i: f.battery.__setitem__(i, 0.14),
    "battery critical": lambda f, i: f.battery.__setitem__(i, 0.06),
    "battery empty": lambda f, i: f.battery.__setitem__(i, 0.01),
    "battery full": lambda f, i: f.battery.__setitem__(i, 0.9),
    "land": send(mavlink.MAV_CMD_NAV_LAND),
    "land on the panic link": send(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 6, link="panic"),
    "hold": send(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3),
    "offboard": send(mavlink.MAV_CMD_DO_SET_MODE, 1, 6),
    "disarm": send(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0),
    "force disarm": send(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196),
    "terminate": send(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1),
    "data link": set_param("NAV_DLL_ACT", 2),
    "shorter offboard timeout": set_param("COM_OF_LOSS_T", 0.02),
    "battery limit above the charge": set_param("BAT_LOW_THR", 0.99),
    "fence": set_param("GF_MAX_HOR_DIST", 0.2),
    "tilt limit": set_param("FD_FAIL_R", 1),
    "dead battery": lambda f, i: (
        set_param("SYS_FAILURE_EN", 1)(f, i),
        send(mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_UNIT_SYSTEM_BATTERY, 1)(f, i),
    )[-1],
    "vision failure": lambda f, i: (
        set_param("SYS_FAILURE_EN", 1)(f, i),
        send(mavlink.MAV_CMD_INJECT_FAILURE, mavlink.FAILURE_UNIT_SENSOR_VIO, 1)(f, i),
    )[-1],
    "heartbeat of a ground station": heartbeat,
    "sticks": sticks,
    "radio on": lambda f, i: f.pilots.sticks(i, True),
    "radio off": lambda f, i: f.pilots.sticks(i, False),
    "flip": flip,
    "arming is refused": lambda f, i: f.pilots.on_request({"do": "refuse_arming"}),
    "home": send(mavlink.MAV_CMD_DO_SET_HOME, 1),
}


def digest_of(script: Callable[[Flight, Pilot, float], None], seconds: float) -> tuple[str, dict[str, Any]]:
    """Fly all vehicles in OFFBOARD, and call `script` 50 times a second. Return a digest of all outputs, and what happened."""
    memory, found, pilot = Memory(), hashlib.sha256(), Pilot()
    f = Flight(VEHICLES, ulog=memory, decoded=())
    transmit, step = f.pilots.transmit, f.pilots.step

    def transmitted() -> list[tuple[int, str, bytes]]:
        sent = transmit()
        found.update(repr(sent).encode())
        return sent

    def stepped(now: float, sensors: Any) -> Any:
        motors = step(now, sensors)
        found.update(motors.tobytes())
        return motors

    f.pilots.transmit, f.pilots.step = transmitted, stepped  # type: ignore[method-assign]
    f.run(2.5, pilot)
    for i in range(VEHICLES):
        send(mavlink.MAV_CMD_DO_SET_MODE, 1, 6)(f, i)
        send(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)(f, i)
    f.run(STEADY_S, pilot)
    assert all(map(f.armed, range(VEHICLES)))
    began = f.now

    def each(f: Flight) -> None:
        pilot(f)
        script(f, pilot, f.now - began)

    f.run(seconds, each)
    for logs in memory.logs.values():
        found.update(b"".join(logs))
    f.world.close()
    return found.hexdigest(), {
        "modes": [f.mode(i) for i in range(VEHICLES)],
        "armed": f.pilots.armed.tolist(),
    }


def always_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SteadyFlights, "update", lambda self, v, now: None)


def assert_same_flight(
    make_script: Callable[[], Callable[[Flight, Pilot, float], None]],
    seconds: float,
    monkeypatch: pytest.MonkeyPatch,
) -> dict[str, Any]:
    digest, ends = digest_of(make_script(), seconds)
    with monkeypatch.context() as patch:
        always_decide(patch)
        assert digest_of(make_script(), seconds) == (digest, ends)
    return ends


@pytest.mark.parametrize("seed", SEEDS)
def test_random_events_have_the_same_effect(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def script() -> Callable[[Flight, Pilot, float], None]:
        draw = random.Random(seed)

        def each(f: Flight, pilot: Pilot, _: float) -> None:
            if draw.random() < 0.03:
                i, name = draw.randrange(VEHICLES), draw.choice([*EVENTS, "silent", "talks", "attitude"])
                if name == "silent":
                    pilot.silent.add(i)
                elif name == "talks":
                    pilot.silent.discard(i)
                    pilot.attitude.discard(i)
                elif name == "attitude":
                    pilot.attitude.add(i)
                else:
                    EVENTS[name](f, i)

        return each

    assert_same_flight(script, 8.0, monkeypatch)


def test_each_kind_of_event_has_the_same_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """In each flight one event happens to each vehicle, one after the other."""
    names = list(EVENTS)
    for first in range(0, len(names), VEHICLES):
        group = names[first : first + VEHICLES]

        def script(group: list[str] = group) -> Callable[[Flight, Pilot, float], None]:
            left = list(enumerate(group))

            def each(f: Flight, pilot: Pilot, since: float) -> None:
                if left and since > 0.073 * (1 + left[0][0]):
                    i, name = left.pop(0)
                    EVENTS[name](f, i)

            return each

        assert_same_flight(script, 1.5, monkeypatch)


def test_lost_setpoints_have_the_same_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    def script() -> Callable[[Flight, Pilot, float], None]:
        return lambda f, pilot, since: pilot.silent.update({0} if since > 0.3 else ())

    ends = assert_same_flight(script, 3.0, monkeypatch)
    assert ends["modes"] == ["AUTO.LAND"] + ["OFFBOARD"] * (VEHICLES - 1)


def test_fence_that_is_crossed_later_has_the_same_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    def script() -> Callable[[Flight, Pilot, float], None]:
        def each(f: Flight, pilot: Pilot, since: float) -> None:
            for i, limit_m in enumerate((1.0, 1.07, 1.13, 1.19, 1.26, 1.33) if since < 0.01 else ()):
                set_param("GF_MAX_HOR_DIST", limit_m)(f, i)
            pilot.aside_m = 2.0 if since > 0.5 else 0.0

        return each

    assert assert_same_flight(script, 3.0, monkeypatch)["modes"] == ["AUTO.LOITER"] * VEHICLES


def test_ground_station_that_is_lost_later_has_the_same_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    def script() -> Callable[[Flight, Pilot, float], None]:
        def each(f: Flight, _: Pilot, since: float) -> None:
            if since < 0.01:
                heartbeat(f, 0)
                set_param("NAV_DLL_ACT", 3)(f, 0)
                set_param("COM_DL_LOSS_T", 5)(f, 0)

        return each

    assert assert_same_flight(script, 9.0, monkeypatch)["modes"] == ["AUTO.LAND"] + ["OFFBOARD"] * (
        VEHICLES - 1
    )


def test_tilt_that_comes_and_goes_has_the_same_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """The time beyond the tilt limit must count from the last time below it."""

    def script() -> Callable[[Flight, Pilot, float], None]:
        def each(f: Flight, pilot: Pilot, since: float) -> None:
            pilot.acceleration_e = math.copysign(2.5, math.sin(since * math.pi / 0.44)) * (since % 0.44 < 0.3)
            for i in range(VEHICLES) if since < 0.01 else ():
                set_param("CBRK_FLIGHTTERM", 0)(f, i)
                set_param("FD_FAIL_R", 7 + i)(f, i)

        return each

    modes = assert_same_flight(script, 2.0, monkeypatch)["modes"]
    assert modes[0] == "TERMINATION" and modes[-1] == "OFFBOARD"


def test_every_condition_of_a_steady_flight_is_checked_in_each_step() -> None:
    steady: list[Flight] = []
    digest_of(lambda f, pilot, since: steady.append(f), 0.02)
    pilots = steady[0].pilots
    law, validity, row = pilots._steady._law, pilots.est.validity, 1
    now, battery = steady[0].now, np.full(VEHICLES, 0.5)
    changes: dict[str, tuple[Any, float]] = {
        "time": (law.decide_at, now),
        "age of the setpoint": (law.offboard.received_at, now - 1.5),
        "position": (validity.xy, 0),
        "height": (validity.z, 0),
        "heading": (validity.yaw, 0),
        "attitude": (validity.state.aligned, 0),
        "tilt": (validity.tilt, 1.5),
        "battery": (battery, 0.05),
        "no battery": (battery, math.nan),
        "landed": (law.landed, 1),
        "flying": (law.flying, 0),
    }
    for what, (values, value) in changes.items():
        law.steady[:] = memoryview(np.ones(VEHICLES, bool))
        assert pilots._steady.rows_to_decide(now, battery) == [], "all are steady"
        before, values[row] = values[row], value
        assert pilots._steady.rows_to_decide(now, battery) == [row], what
        values[row] = before
        assert pilots._steady.rows_to_decide(now, battery) == [row], f"{what}: until the next decision"


def test_steady_vehicle_decides_five_times_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    decided: list[str] = []
    update = Commander.update

    def counted(self: Commander, *args: Any) -> None:
        decided.append(self.name)
        update(self, *args)

    monkeypatch.setattr(Commander, "update", counted)
    digest_of(lambda f, pilot, since: decided.clear() if since < 0.01 else None, 2.0)
    for i in range(VEHICLES):
        assert 9 <= decided.count(f"uav{i + 1}") <= 11
