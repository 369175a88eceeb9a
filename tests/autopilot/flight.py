"""Flights in one process: the world, motion capture as delayed poses, and the built-in autopilots, as fast as possible."""

from __future__ import annotations

from collections import UserDict, deque
from collections.abc import Callable, Container, Sequence
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot import Autopilots
from arena.autopilot.ulog.recorder import Sink
from arena.sim.world import World
from arena.wire.mavlink_codec import Codec

PROFILE: dict[str, Any] = {
    "name": "test_quad",
    "mass_kg": 1.52,
    "inertia_kg_m2": [0.0306, 0.0306, 0.0575],
    "radius_m": 0.275,
    "height_m": 0.10,
    "ground_clearance_m": 0.05,
    "num_rotors": 4,
    "rotors": [
        {"position_m": [0.13, 0.22, -0.02], "direction": "ccw"},
        {"position_m": [-0.13, -0.20, -0.02], "direction": "ccw"},
        {"position_m": [0.13, -0.22, -0.02], "direction": "cw"},
        {"position_m": [-0.13, 0.20, -0.02], "direction": "cw"},
    ],
    "moment_ratio_m": 0.06,
    "motor_up_s": 0.0125,
    "motor_down_s": 0.025,
    "thrust_curve": {"kind": "quadratic", "a": 34.068, "b": 7.1202, "fade_speed_m_s": 25.0},
    "drag_kg_s": [0.46, 0.46, 0.0],
    "sensors": {
        "imu": {
            "accel_noise_m_s2": 0.03,
            "accel_bias_m_s2": 0.05,
            "gyro_noise_rad_s": 0.003,
            "gyro_bias_rad_s": 0.003,
        },
        "baro": {"noise_m": 0.1},
        "mag": {"noise_gauss": 0.004},
        "gps": {
            "horizontal_noise_m": 0.8,
            "vertical_noise_m": 1.78,
            "velocity_noise_m_s": 0.08,
            "rate_hz": 10,
        },
    },
    "battery": {
        "cells": 3,
        "capacity_mah": 5100,
        "full_cell_v": 4.2,
        "empty_cell_v": 3.5,
        "resistance_ohm": 0.03,
        "idle_a": 0.5,
        "hover_a": 20.0,
    },
    "params": {
        "MC_ROLL_P": 6.0,
        "MC_PITCH_P": 6.0,
        "MC_ROLLRATE_P": 0.2,
        "MC_PITCHRATE_P": 0.2,
        "MPC_ACC_HOR_MAX": 3.0,
    },
}

ARENA = {
    "MPC_THR_HOVER": 0.563,
    "EKF2_EV_DELAY": 11.0,
    "EKF2_EVP_NOISE": 0.01,
    "EKF2_EVA_NOISE": 0.05,
    "EKF2_NOAID_TOUT": 1_000_000,
    "COM_OBL_RC_ACT": 4,
    "COM_FAIL_ACT_T": 0.0,
    "COM_RCL_EXCEPT": 4,
    "EKF2_HGT_REF": 3,
    "EKF2_EV_CTRL": 11,
}


Params = dict[str, float]
NONE = [float("nan")] * 21
COVARIANCE = [1e-6 if k in (0, 6, 11, 15, 18, 20) else float("nan") for k in range(21)]
"""Upper triangle of the covariance of a pose, with its diagonal."""


def with_rotors(rotors: int) -> dict[str, Any]:
    """Return PROFILE with this number of rotors, on a circle of 0.25 m."""
    angles = 2.0 * np.pi * (np.arange(rotors) + 0.5) / rotors
    ring = [
        {
            "position_m": [0.25 * float(np.cos(a)), 0.25 * float(np.sin(a)), -0.02],
            "direction": "ccw" if k % 2 else "cw",
        }
        for k, a in enumerate(angles)
    ]
    return {**PROFILE, "rotors": ring, "num_rotors": rotors}


class Received(UserDict[int, list[Any]]):
    """Telemetry messages of each vehicle. Datagrams are decoded when a test reads the list: tests read few of them.

    decoded: ids of the messages that are decoded, None for all
    """

    def __init__(self, vehicles: int, decoded: Container[int] | None) -> None:
        self._decoded, self._codec = decoded, Codec(255, 190)
        self._parsers = [mavlink.MAVLink(None) for _ in range(vehicles)]
        self._waiting: list[list[bytes]] = [[] for _ in range(vehicles)]
        super().__init__({i: [] for i in range(vehicles)})

    def add(self, i: int, data: bytes) -> None:
        if self._decoded is None or any(frame.msgid in self._decoded for frame in self._codec.frames(data)):
            self._waiting[i].append(data)

    def forget(self, i: int) -> None:
        """Discard the messages of a vehicle."""
        self[i] = []

    def __getitem__(self, i: int) -> list[Any]:
        messages: list[Any] = super().__getitem__(i)
        for data in self._waiting[i]:
            if self._decoded is None:
                messages += self._parsers[i].parse_buffer(data) or []
            else:
                messages += self._codec.parse(data, self._decoded)
        self._waiting[i].clear()
        return messages

    def __setitem__(self, i: int, messages: list[Any]) -> None:
        self._waiting[i].clear()
        super().__setitem__(i, messages)


class Flight:
    """V vehicles along east in a wide room.

    params: of all vehicles, or one set for each
    apart_m: distance between two vehicles [m]
    ulog: receives the bytes of the logs
    decoded: ids of the telemetry messages that are decoded, None for all
    vision_on: whether poses of a vehicle arrive (V,)
    faults: changes of the pose, (p_n, q_nb) -> (p_n, q_nb), by vehicle
    battery: charge 0..1 that a vehicle measures instead of the simulated one, by vehicle
    """

    def __init__(
        self,
        vehicles: int = 1,
        seed: int = 1,
        params: Params | Sequence[Params] | None = None,
        apart_m: float = 2.0,
        decoded: Container[int] | None = None,
        ulog: Sink | None = None,
        **world: Any,
    ) -> None:
        each = [params or {}] * vehicles if params is None or isinstance(params, dict) else list(params)
        rows = [
            {
                "name": f"uav{i + 1}",
                "id": i + 1,
                "profile": PROFILE,
                "position": [0.0, apart_m * i, 0.0],
                "rpy": [0.0, 0.0, 0.0],
                "params": {**ARENA, **each[i]},
            }
            for i in range(vehicles)
        ]
        self.settings = {
            "name": "world",
            "seed": seed,
            "size_m": [40.0, 40.0, 20.0],
            "heading_deg": 0.0,
            "origin": None,
            "physics_hz": 500,
            "sensor_hz": 250,
            "wind_m_s": [0.0, 0.0, 0.0],
            "vehicles": rows,
            **world,
        }
        self.world = World(self.settings)
        self.pilots = Autopilots(self.settings, self.world.period_s, ulog=ulog)
        self.rng = np.random.default_rng(seed)
        self.vision_on = np.ones(vehicles, bool)
        self.faults: dict[int, Callable[[Any, Any], tuple[Any, Any]]] = {}
        self.battery: dict[int, float] = {}
        self.vision_noise = (0.0003, 0.0009)
        self.delay_s, self.vision_hz = 0.011, 60.0
        self.received = Received(vehicles, decoded)
        self.codec = [mavlink.MAVLink(None, srcSystem=i + 1, srcComponent=191) for i in range(vehicles)]
        self._poses: deque[tuple[float, Any, Any]] = deque()
        self._next_exposure = 0.0
        self.motors = np.zeros((vehicles, 4))
        self.trace: list[tuple[float, Any, Any, Any]] = []

    @property
    def now(self) -> float:
        return self.world.now

    def run(self, seconds: float, each: Callable[[Flight], None] | None = None) -> Flight:
        """Step for some seconds; call `each` before every fifth step (50 Hz)."""
        for k in range(round(seconds * 250)):
            if each and k % 5 == 0:
                each(self)
            self._step()
        return self

    def until(
        self,
        condition: Callable[[Flight], bool],
        timeout_s: float,
        each: Callable[[Flight], None] | None = None,
    ) -> float:
        """Step until a condition holds and return how long it took [s]. Fails after timeout_s of simulated time."""
        begin = self.now
        while not condition(self):
            assert self.now - begin < timeout_s, f"not within {timeout_s} s of simulated time"
            self.run(0.02, each)
        return self.now - begin

    def _step(self) -> None:
        self.world.step(self.motors)
        if self.now >= self._next_exposure - 1e-9:
            self._next_exposure += 1.0 / self.vision_hz
            truth = self.world.truth()
            self._poses.append((self.now + self.delay_s, truth.p_n, truth.q_nb))
        while self._poses and self._poses[0][0] <= self.now + 1e-9:
            _, p, q = self._poses.popleft()
            self._see(p, q)
        self.motors = self.pilots.step(self.now, self._sense())
        for i, link, data in self.pilots.transmit():
            if link == "router":
                self.received.add(i, data)

    def _sense(self) -> Any:
        sensors = self.world.sense()
        if self.battery:
            remaining = sensors["battery_remaining"].copy()
            remaining[list(self.battery)] = list(self.battery.values())
            sensors = {**sensors, "battery_remaining": remaining}
        return sensors

    def _see(self, p_n: Any, q_nb: Any) -> None:
        for i in np.flatnonzero(self.vision_on):
            p, q = self.faults[i](p_n[i], q_nb[i]) if i in self.faults else (p_n[i], q_nb[i])
            p = p + self.rng.normal(0, self.vision_noise[0], 3)
            m = mavlink.MAVLink_odometry_message(
                0, 1, 12, *p.tolist(), np.asarray(q).tolist(), *NONE[:6], COVARIANCE, NONE, 0, 2, 0
            )
            self.pilots.receive(int(i), "vision", m.pack(self.codec[i]))

    # -- requests of a program ---------------------------------------------------------------------------------------

    def send(self, i: int, message: Any, link: str = "router") -> None:
        self.pilots.receive(i, link, message.pack(self.codec[i]))

    def command(self, i: int, command: int, *p: float, link: str = "router") -> int:
        """Send COMMAND_LONG and return the acknowledged result."""
        self.received.forget(i)
        args = (list(p) + [0.0] * 7)[:7]
        self.send(i, mavlink.MAVLink_command_long_message(i + 1, 1, command, 0, *args), link)
        self.run(0.04)
        acks = [m for m in self.received[i] if m.get_type() == "COMMAND_ACK" and m.command == command]
        assert acks, f"no acknowledgement of {command}"
        return int(acks[-1].result)

    def setpoint(self, i: int, p: Any, yaw: float = 0.0) -> None:
        vectors = (*p, 0, 0, 0, 0, 0, 0)
        self.send(
            i,
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, i + 1, 1, 1, 0b100111111000, *vectors, yaw, 0
            ),
        )

    def offboard(self, i: int) -> int:
        return self.command(i, mavlink.MAV_CMD_DO_SET_MODE, 1, 6, 0)

    def arm(self, i: int) -> int:
        return self.command(i, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def mode(self, i: int) -> str:
        return self.pilots.vehicles[i].commander.mode.label

    def armed(self, i: int) -> bool:
        return bool(self.pilots.vehicles[i].commander.armed)

    def position(self, i: int) -> Any:
        return self.world.truth().p_n[i]
