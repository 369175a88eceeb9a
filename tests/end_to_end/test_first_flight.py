"""The order of a first flight in docs/howto/fly-real.md, section 4, with a vehicle that is carried by hand and flies."""

from __future__ import annotations

import math
import os
import signal
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from carried import Captured, Motion
from fake_autopilot import INT32, REAL32
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink
from served import Connection, Served, UdpPort

from .carried_vehicle import TELEMETRY, Cameras, CarriedAutopilot
from .flight import PROGRAMS, Flight, Hangar, eventually

pytestmark = [pytest.mark.crowd, pytest.mark.alone]  # neither vehicle nor cameras may pause for half a second
COLD = True  # as a user starts it: in a new interpreter
CLIMB_M_S = 0.5
SETPOINT_LOSS_S = 1.0  # COM_OF_LOSS_T
SENSORS = mavlink.MAV_SYS_STATUS_PREARM_CHECK | mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER


@dataclass(kw_only=True, eq=False)
class CarriedAndFlown(Motion):
    """Motion of a vehicle that is carried, and later flies. flown: position relative to where it stood [m] [NED] (3,)."""

    flown: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))

    def p_n(self, t: float) -> Any:
        return super().p_n(t) + self.flown


@dataclass(kw_only=True)
class RealVehicle(CarriedAutopilot):
    """A vehicle with a pilot: it obeys the kill switch, flies to position setpoints, and lands when they stop.

    kill_switch: it is on
    armed_at: times at which it was armed [s]
    """

    moves: CarriedAndFlown
    kill_switch: bool = False
    armed_at: list[float] = field(default_factory=list)
    _stepped_at: float = math.nan

    def state(self, now: float) -> bytes:
        ms, status = int(self.boot_s(now) * 1e3), 8 if self.kill_switch else 4
        custom = {"OFFBOARD": 6 << 16, "AUTO.LAND": 4 << 16 | 6 << 24}.get(self.mode, 4 << 16 | 3 << 24)
        return super().state(now) + self.pack(
            mavlink.MAVLink_attitude_quaternion_message(ms, *self.moves.q_nb(now), 0.0, 0.0, 0.0),
            mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * self.armed, custom, status, 3),
            mavlink.MAVLink_sys_status_message(SENSORS, SENSORS, SENSORS, 0, 12000, 0, 87, 0, 0, 0, 0, 0, 0),
            mavlink.MAVLink_rc_channels_message(ms, 16, *[1500] * 18, 80),
        )

    def step(self, now: float) -> list[bytes]:
        passed, self._stepped_at = now - self._stepped_at, now
        if self.armed and not self.kill_switch and passed > 0.0:
            self._fly(now, passed)
        return super().step(now)

    def _fly(self, now: float, passed_s: float) -> None:
        wanted = np.zeros(3)
        if self.mode == "OFFBOARD":
            at, setpoint = self.setpoints[-1]
            if now - at > SETPOINT_LOSS_S:
                self.mode = "AUTO.LAND"
            wanted = np.array([setpoint.x, setpoint.y, setpoint.z]) - self.moves.start
            self.landed = self.landed and wanted[2] > -0.1
        way = wanted - self.moves.flown
        length = float(np.linalg.norm(way))
        self.moves.flown = self.moves.flown + way * min(1.0, CLIMB_M_S * passed_s / max(length, 1e-9))
        if self.mode == "AUTO.LAND" and self.height_m < 0.01:
            self.landed, self.armed = True, False

    def _descend(self, now: float) -> None:
        pass  # `_fly` does

    def _obey(self, m: Any) -> int:
        if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and m.param1 == 1.0 and self.kill_switch:
            return mavlink.MAV_RESULT_DENIED
        was, result = self.armed, super()._obey(m)
        if self.armed and not was:
            self.armed_at.append(time.monotonic())
        return result

    @property
    def height_m(self) -> float:
        return -float(self.moves.flown[2])


def refusals(flight: Flight) -> str:
    """Return the reasons why the vehicle must not be armed."""
    return "; ".join(flight.status()["processes"]["link.uav1"]["stats"].get("may_not_arm", ["not reported"]))


def carry(flight: Flight, vehicle: RealVehicle) -> str:
    """Run `arena preflight uav1`, carry the vehicle as the command says, and return its output."""
    for _ in range(4):
        with flight.start_cli("preflight", "uav1") as command:
            assert command.stdout is not None
            said = ""
            for line in command.stdout:
                said += line
                if "Lift the vehicle" in line:
                    vehicle.moves.begin = time.monotonic() + 0.5
        vehicle.moves.begin = math.inf
        if command.returncode == 0 or not ("during the motion" in said or "Too slow" in said):
            break  # this computer did not pause
    assert command.returncode == 0, said
    return said


def restarted(flight: Flight) -> None:
    done = flight.cli("restart", "program.uav1")
    assert done.returncode == 0, done.stdout + done.stderr


def test_first_flight_in_the_order_of_the_page(hangar: Hangar) -> None:
    a, b, c, d = hangar.address.split(".")
    room, here = f"{a}.{int(b) + 60}.{c}.{d}", (hangar.address, 14540)
    file = hangar.folder / "arena.yaml"
    file.write_text(f"""\
name: first_flight
address: {hangar.address}
mocap: {{source: natnet, server: {room}, transport: unicast, rate_hz: 60}}
preflight: {{params: false}}
vehicles:
  uav1:
    autopilot: hardware
    profile: iris
    url: "udpin:{here[0]}:{here[1]}"
    program: {{path: '{PROGRAMS / "ready_in_8_s.py"}', args: [hovers]}}
""")
    vehicle = RealVehicle(
        system=1,
        uid2=bytes(range(1, 19)),
        telemetry=tuple(each for each in TELEMETRY if each not in ("HEARTBEAT", "SYS_STATUS")),
        moves=CarriedAndFlown(begin=math.inf),
        params={"EKF2_EV_DELAY": (0.0, REAL32), "RC_MAP_KILL_SW": (5, INT32), "COM_RC_IN_MODE": (0, INT32)},
    )
    cameras = Cameras(address=room, bodies={"uav1": Captured(moves=vehicle.moves)})
    connection = Connection(autopilot=vehicle, port=UdpPort((hangar.address, 14999)), remote=here)
    with cameras, Served([connection]):
        # steps 1 and 2: the program cannot arm, and ends with the reasons
        flight = hangar.up(file, "--yes", "--no-report")
        flight.until_event("program.uav1", "EXITED", 90)
        assert "test the kill switch" in flight.log("program.uav1")
        assert "no axes check" in flight.log("program.uav1")
        # steps 3 to 6
        vehicle.kill_switch = True
        eventually(lambda: "kill switch is on" in refusals(flight), 20, "kill switch", flight.said)
        assert "uav1: passed" in carry(flight, vehicle)
        vehicle.kill_switch = False
        eventually(
            lambda: refusals(flight).startswith("no arm permit"),
            30,
            "only the permit",
            lambda: refusals(flight),
        )
        assert not vehicle.armed_at
        # steps 7 and 8
        permit = flight.cli("arm-permit", "uav1")
        assert permit.returncode == 0, permit.stdout + permit.stderr
        time.sleep(1.0)
        assert not vehicle.armed_at  # nothing flies before the program is started again
        restarted(flight)
        eventually(lambda: vehicle.height_m > 0.9, 30, "hover", flight.said)
        # step 9, and a program that cannot arm before the release
        landed = flight.cli("land-all")
        assert landed.returncode == 0 and "uav1: landed" in landed.stdout, landed.stdout + landed.stderr
        assert not vehicle.armed and vehicle.height_m < 0.05
        restarted(flight)
        flight.until_event("program.uav1", "EXITED", 60, times=3)
        assert len(vehicle.armed_at) == 1
        # step 12: the program is killed; the failsafe lands
        assert flight.cli("release", "uav1").returncode == 0
        restarted(flight)
        eventually(lambda: vehicle.height_m > 0.9, 60, "hover again", flight.said)
        os.kill(flight.status()["processes"]["program.uav1"]["pid"], signal.SIGKILL)
        eventually(lambda: not vehicle.armed, 30, "failsafe landing", flight.said)
        assert len(vehicle.armed_at) == 2
        said = flight.said()
        assert said.count("arming refused") < 8  # in twice 8 s, with a request each second
        killed = said[said.index("killed by SIGKILL") :]
        assert "last line" not in killed, killed  # it printed nothing; an earlier start did
        flight.signal(signal.SIGINT)
        flight.wait()
        assert flight.processes() == set()
