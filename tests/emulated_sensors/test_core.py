"""The core of the emulated sensors: from captured frames and telemetry to MAVLink."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.emulated_sensors.body_filter import SETTLING_FRAMES
from arena.emulated_sensors.core import EmulatedSensors
from arena.emulated_sensors.settings import Settings
from arena.geometry import quat_from_euler
from arena.mocap.client import CapturedFrame, Pose
from arena.wire.relative_measurements import (
    BeaconMeasurement,
    Measurement,
    NeighbourMeasurement,
    measurements,
)

FRAME_S = 1 / 180
Q_NB = tuple(quat_from_euler(np.radians([10, -20, 35])).tolist())


def vehicle(name: str, number: int, **more: Any) -> dict[str, Any]:
    return {
        "name": name,
        "id": number,
        "body": f"body of {name}",
        "simulated": True,
        "estimated": True,
        "router": ["127.0.0.1", 24007 + 10 * number],
        "tools": ["127.0.0.1", 24006 + 10 * number],
        "serve": ["127.0.0.1", 24008 + 10 * number],
        "neighbours": None,
        "beacons": None,
        **more,
    }


def near(*names: str, source: str = "mocap") -> dict[str, Any]:
    noise = {"position_noise_m": 0.0, "velocity_noise_m_s": 0.0}
    return {"vehicles": list(names), "source": source, "rate_hz": 50.0, **noise}


BEACONS = {
    "source": "mocap",
    "rate_hz": 10.0,
    "range_noise_m": 0.0,
    "bearing_noise": 0.0,
    "max_range_m": 20.0,
    "beacons": [{"number": 2, "name": "door", "position": [3.0, -1.0, -2.0]}],
}


def make(*vehicles: dict[str, Any]) -> EmulatedSensors:
    settings = {"vehicles": vehicles, "seed": 1, "frame_rate_hz": 180.0, "pose_noise_m": 3e-4}
    return EmulatedSensors(Settings.of(settings))


PAIR = vehicle("uav1", 1, neighbours=near("uav2")), vehicle("uav2", 2, router=None)


class Flight:
    """uav1 stands at (1, 2, -1); uav2 flies from (3, -1, -2) with (0.5, -0.25, 0.125) m/s. Frames come at 180 Hz."""

    def __init__(self, core: EmulatedSensors) -> None:
        self.core, self.k, self.now = core, 0, 100.0
        self.random = np.random.default_rng(1)

    def frame(self, hidden: tuple[str, ...] = (), *, frozen: bool = False, simulated: bool = True) -> None:
        if not frozen:
            self.noise = self.random.normal(0.0, 1e-5, (2, 3))
        self.k, self.now = self.k + 1, self.now + FRAME_S
        t = self.k * FRAME_S
        places = {"uav1": (1.0, 2.0, -1.0), "uav2": (3.0 + 0.5 * t, -1.0 - 0.25 * t, -2.0 + 0.125 * t)}
        if frozen:
            places["uav2"] = self.last
        self.last = places["uav2"]
        poses = tuple(
            Pose(f"body of {name}", tuple((np.array(p) + n).tolist()), Q_NB)
            for (name, p), n in zip(places.items(), self.noise, strict=True)
            if name not in hidden
        )
        lost = tuple(f"body of {name}" for name in hidden)
        self.core.on_frame(CapturedFrame(self.k, 5.0 + t, poses, lost), simulated, self.now)

    def frames(self, count: int, **more: Any) -> list[Measurement]:
        found: list[Measurement] = []
        for _ in range(count):
            self.frame(**more)
            for row, data in self.core.step(self.now):
                found += measurements(data, self.core.settings.vehicles[row].id)
        return found


def test_captured_neighbour_is_measured_relative_to_the_vehicle() -> None:
    flight = Flight(make(*PAIR))
    flight.frames(SETTLING_FRAMES + 200)
    found = flight.frames(18)
    assert 4 <= len(found) <= 6  # 50 Hz in 0.1 s
    last, t = found[0], 241 * FRAME_S
    assert isinstance(last, NeighbourMeasurement) and last.system_id == 2
    assert last.pos == pytest.approx((2.0 + 0.5 * t, -3.0 - 0.25 * t, -1.0 + 0.125 * t), abs=0.02)
    assert last.vel == pytest.approx((0.5, -0.25, 0.125), abs=0.005)


@pytest.mark.parametrize("lost", ["uav1", "uav2"])
def test_untracked_vehicle_or_neighbour_ends_the_measurements_after_0_1_s(lost: str) -> None:
    flight = Flight(make(*PAIR))
    flight.frames(SETTLING_FRAMES + 20)
    assert 4 <= len(flight.frames(20, hidden=(lost,))) <= 6
    assert flight.frames(100, hidden=(lost,)) == []
    assert flight.frames(SETTLING_FRAMES - 1) == [], "the velocity is not valid yet"
    assert flight.frames(20) != []


def test_frozen_poses_are_not_measured() -> None:
    flight = Flight(make(*PAIR))
    flight.frames(SETTLING_FRAMES + 20)
    flight.frames(20, frozen=True)
    assert flight.frames(50, frozen=True) == []
    assert flight.core.stats()["dropped frozen pose"] > 0


def test_repeated_frames_are_not_measured() -> None:
    flight = Flight(make(*PAIR))
    flight.frames(SETTLING_FRAMES + 20)
    number = flight.k
    for _ in range(40):
        flight.k = number - 1
        flight.frame()
    assert flight.core.step(flight.now) == []


def test_body_of_another_motion_capture_with_the_same_name_is_not_used() -> None:
    flight = Flight(make(*PAIR))
    assert flight.frames(SETTLING_FRAMES + 50, simulated=False) == []


def test_beacon_is_measured_from_the_captured_pose() -> None:
    flight = Flight(make(vehicle("uav1", 1, beacons=BEACONS)))
    found = flight.frames(SETTLING_FRAMES + 36)
    assert all(isinstance(m, BeaconMeasurement) and m.number == 2 for m in found)
    assert found[-1].range_m == pytest.approx(np.linalg.norm([2.0, -3.0, -1.0]), abs=1e-3)


def telemetry(system: int, pos: tuple[float, ...], vel: tuple[float, ...]) -> bytes:
    out = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    local = mavlink.MAVLink_local_position_ned_message(1000, *pos, *vel)
    return local.pack(out) + mavlink.MAVLink_attitude_quaternion_message(1000, *Q_NB, 0, 0, 0).pack(out)


def estimated() -> EmulatedSensors:
    return make(
        vehicle("uav1", 1, neighbours=near("uav2", source="estimator")),
        vehicle("uav2", 2, router=None),
    )


def test_estimates_of_different_times_are_extrapolated_to_the_same_time() -> None:
    core = estimated()
    core.on_datagram(0, telemetry(1, (1.0, 2.0, -1.0), (1.0, 0.0, 0.0)), 9.98)
    core.on_datagram(1, telemetry(2, (4.0, 0.0, -3.0), (0.0, -2.0, 0.5)), 9.90)
    ((row, data),) = core.step(10.0)
    (m,) = measurements(data, 1)
    assert row == 0 and isinstance(m, NeighbourMeasurement)
    assert m.pos == pytest.approx((4.0 - 1.02, -0.2 - 2.0, -2.95 + 1.0), abs=1e-5)
    assert m.vel == pytest.approx((-1.0, -2.0, 0.5)) and m.time_s == 10.0


def test_neighbour_whose_telemetry_ends_is_not_measured() -> None:
    core = estimated()
    core.on_datagram(1, telemetry(2, (4.0, 0.0, -3.0), (0.0, 0.0, 0.0)), 9.0)
    own = telemetry(1, (1.0, 2.0, -1.0), (0.0, 0.0, 0.0))
    core.on_datagram(0, own, 9.2)
    assert core.step(9.2) != []
    core.on_datagram(0, own, 9.3)
    assert core.step(9.3) == []


def test_telemetry_of_another_system_is_ignored() -> None:
    core = estimated()
    core.on_datagram(0, telemetry(1, (1.0, 2.0, -1.0), (0.0, 0.0, 0.0)), 10.0)
    core.on_datagram(1, telemetry(3, (4.0, 0.0, -3.0), (0.0, 0.0, 0.0)), 10.0)
    assert core.step(10.0) == []


def test_only_vehicles_with_sensors_are_addressed() -> None:
    core = make(
        vehicle("uav2", 2, router=None),
        vehicle("uav1", 1, neighbours=near("uav2", source="estimator")),
    )
    core.on_datagram(0, telemetry(2, (4.0, 0.0, -3.0), (0.0, 0.0, 0.0)), 10.0)
    core.on_datagram(1, telemetry(1, (1.0, 2.0, -1.0), (0.0, 0.0, 0.0)), 10.0)
    ((row, data),) = core.step(10.0)
    assert row == 1 and [m.system_id for m in measurements(data, 1)] == [2]
    assert core.stats()["uav1 measurements"] == 1
