"""Description of an arena for viewers (programs that show it): room, geofence and vehicles. Pure.

It is known before the first message arrives. The slice `view.json` of the run folder contains it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from arena.constants import OFFBOARD_LOSS_S
from arena.errors import RunError
from arena.obstacles import Obstacle, obstacles_of

Kind = Literal["simulated", "real", "replayed"]
"""Origin of a vehicle's motion: the simulated world, a real vehicle, or a recorded flight that is played back."""


@dataclass(frozen=True, kw_only=True)
class Fence:
    """The geofence of an arena: a box that the centres of the vehicles must not leave.

    north, east: lowest and highest coordinate [m] [NED].  up: height above the floor [m].
    """

    north: tuple[float, float]
    east: tuple[float, float]
    up: float


@dataclass(frozen=True, kw_only=True)
class Rotor:
    """A rotor of a vehicle. position_b: [m] [FRD] (3,).  clockwise: direction of rotation seen from above."""

    position_b: tuple[float, float, float]
    clockwise: bool


@dataclass(frozen=True, kw_only=True)
class VehicleSettings:
    """Description of one vehicle for viewers: name, size, rotors, and the sources of its state.

    id: MAVLink system id.
    index: row of the vehicle in the truth page; None if the vehicle has no simulated body.
    body: name of its rigid body in the motion capture.
    tools: address of the router's tools port, from which the telemetry comes; None if the arena has no router.
    start_n: lowest point of the vehicle at the start [m] [NED] (3,).
    radius_m: horizontal distance from the body origin to the farthest point of the vehicle [m].
    offboard_loss_s: time without setpoints in OFFBOARD after which the failsafe acts, COM_OF_LOSS_T [s].
    """

    name: str
    id: int
    kind: Kind
    autopilot: str
    index: int | None
    body: str
    tools: tuple[str, int] | None
    profile: str
    radius_m: float
    height_m: float
    rotors: tuple[Rotor, ...]
    start_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offboard_loss_s: float = OFFBOARD_LOSS_S

    @classmethod
    def of(cls, raw: Mapping[str, Any]) -> VehicleSettings:
        """Convert the entry of one vehicle in `view.json` to a `VehicleSettings`."""
        kind: Kind = "replayed" if raw.get("replayed") else "simulated" if raw["simulated"] else "real"
        rotors = tuple(
            Rotor(position_b=_triple(r["position_m"]), clockwise=r["direction"] == "cw")
            for r in raw["rotors"]
        )
        return cls(
            name=str(raw["name"]),
            id=int(raw["id"]),
            kind=kind,
            autopilot=str(raw["autopilot"]),
            index=None if raw["index"] is None else int(raw["index"]),
            body=str(raw["body"]),
            tools=None if raw["tools"] is None else (str(raw["tools"][0]), int(raw["tools"][1])),
            start_n=_triple(raw["start"]),
            profile=str(raw["profile"]),
            radius_m=float(raw["radius_m"]),
            height_m=float(raw["height_m"]),
            rotors=rotors,
            offboard_loss_s=float(raw.get("offboard_loss_s", OFFBOARD_LOSS_S)),
        )


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Description of an arena for viewers: the room, the vehicles, and the sources of the vehicle states.

    size_m: north, east and height of the room [m].  ceiling: false if the room is open to the sky.
    fence: None without a geofence.  obstacles: fixed bodies in the room.
    clock: path of the simulation clock without suffix; None without a simulated world.
    truth: path of the truth page; None without a simulated world.
    paths: folder with the planned paths; None without one.
    captures: settings of motion capture receivers, one per server.
    """

    size_m: tuple[float, float, float]
    ceiling: bool
    fence: Fence | None
    clock: str | None
    truth: str | None
    captures: tuple[Mapping[str, Any], ...]
    vehicles: tuple[VehicleSettings, ...]
    obstacles: tuple[Obstacle, ...] = ()
    paths: str | None = None

    @classmethod
    def from_slice(cls, raw: Mapping[str, Any]) -> Settings:
        """Convert the content of `view.json` (the viewers' configuration) to a `Settings`.

        Raises RunError if a key is missing or has the wrong type.
        """
        try:
            return cls(
                size_m=_triple(raw["size_m"]),
                ceiling=bool(raw["ceiling"]),
                fence=_fence(raw["fence"]),
                clock=raw["clock"],
                truth=raw["truth"],
                captures=tuple(raw["captures"]),
                vehicles=tuple(VehicleSettings.of(v) for v in raw["vehicles"]),
                obstacles=obstacles_of(raw.get("obstacles")),
                paths=raw.get("paths"),
            )
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise RunError(
                f"cannot read view.json, the run's configuration for viewers ({type(error).__name__}: {error}): "
                "was the arena started by another version of arena?"
            ) from error


def _fence(raw: Mapping[str, Any] | None) -> Fence | None:
    if raw is None:
        return None
    (south, north), (west, east) = raw["north"], raw["east"]
    return Fence(north=(float(south), float(north)), east=(float(west), float(east)), up=float(raw["up"]))


def _triple(raw: Any) -> tuple[float, float, float]:
    x, y, z = raw
    return float(x), float(y), float(z)
