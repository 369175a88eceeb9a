"""Scenarios of single vehicles that share one simulated flight: each test is one vehicle, all fly at the same time.

A scenario is a generator function of a `Lane`; it waits with `yield from lane.run(...)` or `yield from lane.until(...)`. The
module's fixture `lanes` flies the selected scenarios together and each test raises what its own scenario raised.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Generator
from typing import Any

import numpy as np
import pytest
from flight import Flight, Params
from pymavlink.dialects.v20 import common as mavlink

APART_M = 12.0
LAT, LON, ALT = 38.7, -9.1, 100.0
RADIUS_M = 6_371_000.0
RELATIVE = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT

# what scenarios look at: texts, acknowledgements, the mission protocol
_DECODED = {
    mavlink.MAVLINK_MSG_ID_STATUSTEXT,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
    mavlink.MAVLINK_MSG_ID_MISSION_ACK,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_INT,
    mavlink.MAVLINK_MSG_ID_MISSION_ITEM_REACHED,
}

Wait = Generator[None, None, Any]
Item = dict[str, Any]


class Lane:
    """One vehicle of a shared flight. Positions are relative to its start [m] [NED]."""

    def __init__(self, flight: Flight, i: int, apart_m: float) -> None:
        self.flight, self.i, self.start = flight, i, np.array([0.0, apart_m * i, 0.0])

    # -- state ---------------------------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        return self.flight.now

    @property
    def position(self) -> Any:
        return self.flight.position(self.i) - self.start

    @property
    def v_n(self) -> Any:
        return self.flight.world.truth().v_n[self.i]

    @property
    def mode(self) -> str:
        return self.flight.mode(self.i)

    @property
    def armed(self) -> bool:
        return self.flight.armed(self.i)

    @property
    def vehicle(self) -> Any:
        return self.flight.pilots.vehicles[self.i]

    def away(self, p: Any) -> float:
        """Return the distance from a point [m]."""
        return float(np.linalg.norm(self.position - p))

    def away_level(self, north: float = 0.0, east: float = 0.0) -> float:
        """Return the horizontal distance from a point [m]."""
        return float(np.hypot(*(self.position[:2] - [north, east])))

    def messages(self, kind: str) -> list[Any]:
        """Return the received messages of a type."""
        return [m for m in self.flight.received[self.i] if m.get_type() == kind]

    def texts(self) -> str:
        """Return all received STATUSTEXT, joined: a long text arrives in several messages."""
        return "".join(m.text for m in self.messages("STATUSTEXT"))

    def clear(self) -> None:
        """Forget the received messages."""
        self.flight.received.forget(self.i)

    # -- waiting -------------------------------------------------------------------------------------------------------

    def run(self, seconds: float, each: Callable[[], None] | None = None) -> Wait:
        """Wait; call `each` 50 times a second."""
        for _ in range(round(seconds * 50)):
            if each:
                each()
            yield

    def until(
        self, condition: Callable[[], bool], timeout_s: float, each: Callable[[], None] | None = None
    ) -> Wait:
        """Wait for a condition; return how long it took [s]."""
        begin = self.now
        while not condition():
            assert self.now - begin < timeout_s, f"not within {timeout_s} s of simulated time"
            yield from self.run(0.02, each)
        return self.now - begin

    # -- requests ------------------------------------------------------------------------------------------------------

    def send(self, message: Any, link: str = "router") -> None:
        """Send a message to the vehicle."""
        self.flight.send(self.i, message, link)

    def setpoint(self, p: Any, yaw: float = 0.0) -> None:
        """Send a position setpoint."""
        self.flight.setpoint(self.i, self.start + p, yaw)

    def holding(self, p: Any, yaw: float = 0.0) -> Callable[[], None]:
        """Return a function that sends a position setpoint."""
        return lambda: self.setpoint(p, yaw)

    def command(self, command: int, *p: float) -> Wait:
        """Send COMMAND_LONG; return the acknowledged result."""
        count = len(self.messages("COMMAND_ACK"))
        args = (list(p) + [0.0] * 7)[:7]
        self.send(mavlink.MAVLink_command_long_message(self.i + 1, 1, command, 0, *args))
        yield from self.run(0.04)
        acks = [m for m in self.messages("COMMAND_ACK")[count:] if m.command == command]
        assert acks, f"no acknowledgement of {command}"
        return int(acks[-1].result)

    def set_mode(self, main: int, sub: int = 0) -> Wait:
        """Select a flight mode; return the result."""
        return (yield from self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub))

    def arm(self) -> Wait:
        """Arm; return the result."""
        return (yield from self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1))

    def take_off_offboard(self, height: float = 1.2) -> Wait:
        """Take off in OFFBOARD and hover; return the function that keeps the setpoints coming."""
        stream = self.holding([0, 0, -height])
        yield from self.run(0.5, stream)
        assert (yield from self.set_mode(6)) == 0
        stream()
        assert (yield from self.arm()) == 0
        yield from self.until(lambda: self.position[2] < -height + 0.15, 15, stream)
        yield from self.run(2.0, stream)
        return stream

    # -- missions ------------------------------------------------------------------------------------------------------

    def shifted(self, items: list[Item]) -> list[Item]:
        """Return the items moved from the first lane to this one."""
        east = round(math.degrees(self.start[1] / (RADIUS_M * math.cos(math.radians(LAT)))) * 1e7)
        return [{**it, "y": it["y"] + east} if it["frame"] == RELATIVE else it for it in items]

    def upload(self, items: list[Item], kind: int = 0) -> Wait:
        """Upload a list; return the result of MISSION_ACK. Places are relative to the start of the lane."""
        items = self.shifted(items)
        kept, self.flight.received[self.i] = self.flight.received[self.i], []
        self.send(mavlink.MAVLink_mission_count_message(self.i + 1, 1, len(items), kind))
        for _ in range(20 + 5 * len(items)):
            yield from self.run(0.02)
            received, self.flight.received[self.i] = self.flight.received[self.i], []
            kept += received
            for m in received:
                if m.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
                    self._send_item(m.seq, items[m.seq], kind)
                elif m.get_type() == "MISSION_ACK":
                    yield from self.run(0.1)
                    self.flight.received[self.i] = kept + self.flight.received[self.i]
                    return int(m.type)
        raise AssertionError("the upload was never acknowledged")

    def _send_item(self, seq: int, it: Item, kind: int) -> None:
        self.send(
            mavlink.MAVLink_mission_item_int_message(
                self.i + 1,
                1,
                seq,
                it["frame"],
                it["command"],
                0,
                1,
                *it["params"],
                it["x"],
                it["y"],
                it["z"],
                kind,
            )
        )


Scenario = Callable[[Lane], Wait]


class Scenarios:
    """The scenarios of one test module."""

    def __init__(self) -> None:
        self._all: dict[str, tuple[Scenario, Params]] = {}

    def __call__(self, _scenario: Scenario | None = None, **params: float) -> Any:
        """Register a scenario flown with these parameters, and return the test that reports its result."""

        def register(scenario: Scenario) -> Callable[[dict[str, Any]], None]:
            return self._register(scenario.__name__, scenario, params)

        return register(_scenario) if _scenario else register

    def add(self, name: str, scenario: Scenario, **params: float) -> Callable[[dict[str, Any]], None]:
        """Register a scenario under a name, for cases of one behaviour; return its test."""
        return self._register(name, scenario, params)

    def _register(self, name: str, scenario: Scenario, params: Params) -> Callable[[dict[str, Any]], None]:
        self._all[name] = (scenario, params)

        @functools.wraps(scenario)
        def test(lanes: dict[str, Any]) -> None:
            if lanes[name] is not None:
                raise lanes[name]

        test.__name__ = name
        test.__doc__ = scenario.__doc__
        del test.__wrapped__  # type: ignore[attr-defined]
        return test

    def fixture(self, *, origin: bool, gcs: bool = True) -> Any:
        """Return the fixture `lanes`: the exception or None of each selected scenario."""

        @pytest.fixture(scope="module", name="lanes")
        def fly(request: pytest.FixtureRequest) -> dict[str, BaseException | None]:
            path = request.path
            selected = {getattr(x, "originalname", x.name) for x in request.session.items if x.path == path}
            return self.fly([name for name in self._all if name in selected], origin=origin, gcs=gcs)

        return fly

    def fly(self, names: list[str], *, origin: bool, gcs: bool) -> dict[str, BaseException | None]:
        """Fly scenarios side by side; return the exception or None of each."""
        n = len(names)
        flight = Flight(
            n,
            params=[self._all[name][1] for name in names],
            apart_m=APART_M,
            decoded=_DECODED,
            size_m=[60.0, 2 * APART_M * (n + 1), 30.0],
        )
        lanes = [Lane(flight, i, APART_M) for i in range(n)]
        for lane in lanes:
            if gcs:  # a ground station whose heartbeat never stops
                lane.vehicle.gcs_heartbeat_at = 1e9
                flight.pilots.interfaces[lane.i].links["router"].gcs_heartbeat_at = 1e9
            if origin:
                place = (round(LAT * 1e7), round(LON * 1e7), int(ALT * 1e3))
                lane.send(mavlink.MAVLink_set_gps_global_origin_message(lane.i + 1, *place, 0), "vision")
        flight.until(lambda f: all(v.ready_to_arm for v in f.pilots.vehicles), 20)
        flight.run(0.1)
        running = {name: self._all[name][0](lane) for name, lane in zip(names, lanes, strict=True)}
        results: dict[str, BaseException | None] = dict.fromkeys(names)
        while running:
            for name, scenario in list(running.items()):
                try:
                    next(scenario)
                except StopIteration:
                    del running[name]
                except (Exception, pytest.fail.Exception) as error:
                    results[name] = error
                    del running[name]
            flight.run(0.02)
        return results


# -- mission items -----------------------------------------------------------------------------------------------------


def lat_lon(north: float, east: float) -> tuple[int, int]:
    """Return latitude, longitude [1e-7 deg] of a point relative to the first start [m]."""
    lat = LAT + math.degrees(north / RADIUS_M)
    lon = LON + math.degrees(east / (RADIUS_M * math.cos(math.radians(LAT))))
    return round(lat * 1e7), round(lon * 1e7)


def item(
    command: int,
    north: float = 0.0,
    east: float = 0.0,
    up: float = 0.0,
    p: tuple[float, ...] = (),
    **more: Any,
) -> Item:
    """Return an item with a position, relative to home. p: its first parameters; the default heading is free."""
    x, y = lat_lon(north, east)
    params = (*p, *(0.0, 0.0, 0.0, math.nan)[len(p) :])
    return {"frame": RELATIVE, "command": command, "params": params, "x": x, "y": y, "z": up, **more}


def do(command: int, *p: float) -> Item:
    """Return an item without a position."""
    params = (*p, *(0.0,) * 4)[:4]
    frame = mavlink.MAV_FRAME_MISSION
    return {"frame": frame, "command": command, "params": params, "x": 0, "y": 0, "z": 0.0}


def waypoint(
    north: float, east: float, up: float, hold: float = 0.0, within: float = 0.3, yaw: float = math.nan
) -> Item:
    """Return a waypoint. hold: [s]; within: acceptance radius [m]; yaw: [deg]."""
    return item(mavlink.MAV_CMD_NAV_WAYPOINT, north, east, up, (hold, within, 0.0, yaw))
