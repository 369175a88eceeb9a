"""Settings of a `link.<vehicle>` process, read from its JSON configuration (slice)."""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from arena.errors import InputError
from arena.transport import Address, ConnectionUrl, url_from_json


@dataclass(frozen=True, kw_only=True)
class LinkAddresses:
    """Local and remote address of one UDP link of the link process.

    local: address of this process. remote: only accepted sender
    """

    local: Address
    remote: Address


@dataclass(frozen=True, kw_only=True)
class Preflight:
    """Limits of the preflight checks. A vehicle outside these limits cannot be armed.

    position_m, yaw_deg: maximum difference between the captured pose and the autopilot's estimate
    tilt_deg: maximum angle between the captured direction down and the accelerometer's, at rest
    imu: the vehicle must not be armed before its accelerometer agrees with the captured tilt
    pose_age_s: maximum age of the last pose sent to the vehicle
    pose_rate_hz: rate at which poses are sent
    battery: minimum charge, 0 to 1 [-]; 0 for a battery that is not measured
    size_m: size of the arena north, east and up [m]
    height_m: distance from the body's origin down to its lowest point [m]
    poses: a pose forwarder sends poses to the vehicle
    radio: values of COM_RC_IN_MODE with which the pilot's RC transmitter works; None if no transmitter is required
    axes_check: the vehicle must not be armed before it has passed the guided identity and axes check
    """

    position_m: float
    yaw_deg: float
    tilt_deg: float
    pose_age_s: float
    pose_rate_hz: float
    battery: float
    size_m: tuple[float, float, float]
    height_m: float
    poses: bool
    imu: bool = False
    radio: tuple[int, ...] | None = None
    axes_check: bool = False


@dataclass(frozen=True, kw_only=True)
class RebootRecord:
    """Place where `arena params push` records that a vehicle must still be rebooted.

    folder: folder of the YAML, with the file missing_reboots.json. address: address of the vehicle, as text in that file
    """

    folder: str
    address: str


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Settings of one link process: addresses, limits of the preflight checks, required parameters.

    connection: URL of the flight controller
    links: UDP addresses of the link to the MAVLink router ("router"), to the pose forwarder ("vision"), and to land-all and
        kill-all ("panic")
    simulator: TCP address of the world's simulator port, for hardware in the loop; None for a vehicle that
    flies
    params: parameters that the vehicle must have before it can be armed
    uid: hardware uid of the vehicle in hexadecimal digits; "none": its autopilot reports no uid; "": any
    params_file: file for QGroundControl to which the parameters are written; "" for none
    missing_reboots: where a reboot is recorded that the vehicle still needs
    wire_file: file for land-all to which the vehicle's last address is written; "" for none
    key_file: file with the key of MAVLink signing; "" if the vehicle does not sign
    body: name of the vehicle's rigid body
    capture: settings of a motion-capture client that receives all bodies, for the axes check; None without such a server
    axes_file: file with the record of the last axes check; "" if nothing is recorded
    """

    vehicle: str
    id: int
    connection: ConnectionUrl
    links: Mapping[str, LinkAddresses]
    simulator: Address | None
    preflight: Preflight
    params: Mapping[str, float]
    params_file: str
    simulated: bool
    uid: str
    missing_reboots: RebootRecord
    wire_file: str = ""
    key_file: str = ""
    body: str = ""
    capture: Mapping[str, Any] | None = None
    axes_file: str = ""

    @classmethod
    def from_slice(cls, raw: Mapping[str, Any]) -> Settings:
        """Read the JSON configuration (slice) of the process.

        Raises InputError that names a missing or wrong key.

        Limits have no default values, because a missing limit must not disable a preflight check.
        """
        try:
            return cls(
                vehicle=str(raw["vehicle"]),
                id=int(raw["id"]),
                connection=_connection(raw["wire"]),
                links={
                    n: LinkAddresses(
                        local=_address(raw["links"][n]["local"]), remote=_address(raw["links"][n]["remote"])
                    )
                    for n in ("router", "vision", "panic")
                },
                simulator=_address(raw["simulator"]) if raw["simulator"] is not None else None,
                preflight=_preflight(raw["preflight"]),
                params={str(k): _finite(f"params.{k}", v) for k, v in raw["params"].items()},
                params_file=str(raw["params_file"]),
                simulated=bool(raw["simulated"]),
                uid=str(raw["uid"]),
                missing_reboots=RebootRecord(
                    folder=str(raw["missing_reboots"]["folder"]),
                    address=str(raw["missing_reboots"]["address"]),
                ),
                wire_file=str(raw.get("wire_file", "")),
                key_file=str(raw.get("key_file", "")),
                body=str(raw["body"]),
                capture=raw["capture"],
                axes_file=str(raw.get("axes_file", "")),
            )
        except (KeyError, TypeError) as error:
            what = f"{type(error).__name__} {error}"
            raise InputError(
                f"configuration of the link process: missing or wrong key: {what} (docs/reference/slices.md)"
            ) from error


def _connection(raw: Any) -> ConnectionUrl:
    try:
        return url_from_json(raw)
    except ValueError as error:
        raise InputError(
            f"configuration of the link process: key `wire` is not a connection: {error} (docs/reference/slices.md)"
        ) from error


def _preflight(raw: Mapping[str, Any]) -> Preflight:
    poses = bool(raw["poses"])
    needed = ("position_m", "yaw_deg", "tilt_deg", "pose_age_s", "pose_rate_hz")
    limits = {k: _above(f"preflight.{k}", raw[k]) if poses else 0.0 for k in needed}
    north, east, height = (_above("preflight.size_m", x) for x in raw["size_m"])
    return Preflight(
        **limits,
        battery=_finite("preflight.battery", raw["battery"] or 0.0),
        size_m=(north, east, height),
        height_m=_finite("preflight.height_m", raw["height_m"]),
        poses=poses,
        imu=poses and bool(raw["imu"]),
        radio=None if raw["radio"] is None else tuple(int(mode) for mode in raw["radio"]),
        axes_check=poses and bool(raw["axes_check"]),
    )


def _above(name: str, value: Any) -> float:
    number = _finite(name, value)
    if number <= 0.0:
        raise InputError(
            f"configuration of the link process: {name}: got {value!r}, "
            "expected a number above 0 (0 does not disable the check)"
        )
    return number


def _finite(name: str, value: Any) -> float:
    """Return a number of the configuration. Raises InputError if the value is not a finite number.

    An int stays an int.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(
            f"configuration of the link process: {name}: got {value!r}, expected a finite number"
        )
    return value


def _address(raw: Any) -> Address:
    try:
        host, port = raw
        return str(ipaddress.IPv4Address(host)), int(port)
    except ValueError as error:
        raise InputError(
            f"configuration of the link process: got {raw!r}, expected [numeric IPv4 host, port]: {error}"
        ) from error
