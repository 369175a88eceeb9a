"""Settings of the emulated sensors, read from the JSON configuration (slice) of the process `sensors`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from arena.transport import Address

Source = Literal["mocap", "estimator"]
Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class NeighbourSettings:
    """Settings of a sensor that measures neighbours.

    rows: index of each neighbour in the list of vehicles.  position_noise_m, velocity_noise_m_s: added noise, rms per axis.
    """

    rows: tuple[int, ...]
    source: Source
    rate_hz: float
    position_noise_m: float
    velocity_noise_m_s: float


@dataclass(frozen=True, kw_only=True)
class Beacon:
    """Beacon at a fixed position in the room.

    number: from 1, in the order of the YAML. p_n: [m] [NED].
    """

    number: int
    p_n: Triple


@dataclass(frozen=True, kw_only=True)
class BeaconSettings:
    """Settings of a sensor that measures beacons.

    range_noise_m, bearing_noise: added noise of the distance [m] and of each angle [rad], rms.  max_range_m: a beacon that is
    farther away is not measured [m].
    """

    beacons: tuple[Beacon, ...]
    source: Source
    rate_hz: float
    range_noise_m: float
    bearing_noise: float
    max_range_m: float


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Settings of one vehicle that has emulated sensors, or is measured by them as a neighbour.

    id: MAV_SYS_ID.  body: name of its rigid body.  simulated: True if the motion capture emulator measures it, False for the cameras.
    router: address of the router that accepts the measurements of this vehicle; None: it has no sensors.
    tools: address of the router from which its telemetry comes.  serve: address from which the router sends its messages.
    estimated: whether its estimates are needed.
    """

    name: str
    id: int
    body: str
    simulated: bool
    router: Address | None
    tools: Address
    serve: Address
    estimated: bool
    neighbours: NeighbourSettings | None
    beacons: BeaconSettings | None


@dataclass(frozen=True, kw_only=True)
class Settings:
    """All settings of the process `sensors`.

    seed: seed of the noise.  frame_rate_hz: rate of motion capture [Hz].  pose_noise_m: noise of a captured position, rms per
    axis [m].
    """

    vehicles: tuple[Vehicle, ...]
    seed: int
    frame_rate_hz: float
    pose_noise_m: float

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> Settings:
        """Read the settings from the JSON configuration (slice) of the process.

        Raises KeyError.
        """
        row_of = {str(v["name"]): row for row, v in enumerate(raw["vehicles"])}
        return cls(
            vehicles=tuple(_vehicle(v, row_of) for v in raw["vehicles"]),
            seed=int(raw["seed"]),
            frame_rate_hz=float(raw["frame_rate_hz"]),
            pose_noise_m=float(raw["pose_noise_m"]),
        )


def _vehicle(raw: Mapping[str, Any], row_of: Mapping[str, int]) -> Vehicle:
    near, beacons = raw["neighbours"], raw["beacons"]
    return Vehicle(
        name=str(raw["name"]),
        id=int(raw["id"]),
        body=str(raw["body"]),
        simulated=bool(raw["simulated"]),
        router=None if raw["router"] is None else _address(raw["router"]),
        tools=_address(raw["tools"]),
        serve=_address(raw["serve"]),
        estimated=bool(raw["estimated"]),
        neighbours=None if near is None else _neighbours(near, row_of),
        beacons=None if beacons is None else _beacons(beacons),
    )


def _neighbours(raw: Mapping[str, Any], row_of: Mapping[str, int]) -> NeighbourSettings:
    return NeighbourSettings(
        rows=tuple(row_of[name] for name in raw["vehicles"]),
        source=raw["source"],
        rate_hz=float(raw["rate_hz"]),
        position_noise_m=float(raw["position_noise_m"]),
        velocity_noise_m_s=float(raw["velocity_noise_m_s"]),
    )


def _beacons(raw: Mapping[str, Any]) -> BeaconSettings:
    return BeaconSettings(
        beacons=tuple(Beacon(number=int(b["number"]), p_n=_triple(b["position"])) for b in raw["beacons"]),
        source=raw["source"],
        rate_hz=float(raw["rate_hz"]),
        range_noise_m=float(raw["range_noise_m"]),
        bearing_noise=float(raw["bearing_noise"]),
        max_range_m=float(raw["max_range_m"]),
    )


def _triple(raw: Any) -> Triple:
    north, east, down = (float(x) for x in raw)
    return north, east, down


def _address(raw: Any) -> Address:
    host, port = raw
    return str(host), int(port)
