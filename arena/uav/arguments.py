"""Parses the command line of a user program, which selects the vehicle to fly.

`arena up` passes a file with all settings; a user who starts the program by hand gives single options.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from arena.clock import Clock, SimClock
from arena.errors import InputError
from arena.mocap.vendors import VENDORS, vendor_settings
from arena.uav.measurements import RelativeSensors
from arena.uav.membership import MEMBERSHIP, Membership

UAV_FILE_VARIABLE = "ARENA_UAV_FILE"
"""Environment variable with the path of the settings file, for programs that `arena up` starts."""
_DEFAULT_NS, _DEFAULT_PROFILE = "uav1", "iris"


ClockOf = Callable[[str | None, str], Clock | None]
"""Function that returns the clock for the path of a simulation clock (None: wall clock) and the name of a vehicle."""


def read_arguments(argv: Sequence[str] | None = None, clock_of: ClockOf | None = None) -> dict[str, Any]:
    """Parse the command line of a user program and return the keyword arguments for `UAV`. Raises InputError.

    argv: arguments without the program's name; None for those of this process.
    clock_of: function that returns the clock; None for clocks on which the program blocks.
    """
    member = MEMBERSHIP.get() if argv is None else None
    if member is not None:
        return _of_member(member)
    given, others = _parser().parse_known_args(argv)
    file = given.uav or _file_of_arena(given, argv)
    found = _from_slice(file, clock_of or _clock) if file else _by_hand(given, clock_of or _clock)
    return {**found, "args": others}


def simulation_clock(argv: Sequence[str] | None = None) -> tuple[str, str] | None:
    """Return the simulation clock that this program must use, or None if it uses the wall clock.

    The clock is given as (path of its files, name of this program as its client). Raises InputError. argv: as in `read_arguments`.
    """
    found: list[tuple[str, str]] = []

    def note(stem: str | None, name: str) -> None:
        found.extend([(stem, name)] if stem else [])

    member = MEMBERSHIP.get() if argv is None else None
    if member is None:
        read_arguments(argv, note)
    elif member.once:
        return member.threads.client
    else:
        raise InputError(
            "run: an asynchronous program that flies a group of vehicles needs `run: once` in the YAML"
        )
    return found[0] if found else None


def read_file(file: str, clock_of: Callable[[str | None, str], Clock | None]) -> dict[str, Any]:
    """Return the keyword arguments for `UAV` from the vehicle file that `arena up` writes. Raises InputError.

    The file belongs to the program of one vehicle.

    clock_of: function of the path of the simulation clock (None for a real vehicle) and of the vehicle's name; returns the clock.
    """
    return _from_slice(file, clock_of)


def _file_of_arena(given: argparse.Namespace, argv: Sequence[str] | None) -> str:
    """Return the path of the vehicle file from the environment variable ARENA_UAV_FILE, or "" without one.

    Such an executable is, for example, a shell program that starts Python. "" is returned for a program that is
    started by hand or selects its vehicle by options.
    """
    by_hand = any(value is not None for value in vars(given).values())
    return "" if argv is not None or by_hand else os.environ.get(UAV_FILE_VARIABLE, "")


def read_group(member: Membership | None, clock_of: ClockOf | None = None) -> list[dict[str, Any]]:
    """Return the keyword arguments for each `UAV` of a program that flies all vehicles of a group.

    Raises InputError if the program flies only one vehicle.

    clock_of: as in `read_arguments`.
    """
    if member is None or not member.once:
        raise InputError(
            "UAV.all_from_args: this program flies one vehicle. Use UAV.from_args, or write "
            "`program: {path: FILE.py, group: NAME, run: once}` in the YAML"
        )
    return [_arguments_of(member, argv, clock_of) for argv in member.argv.values()]


def _of_member(member: Membership) -> dict[str, Any]:
    if member.once:
        raise InputError(
            "UAV.from_args: this program flies a whole group (`run: once` in the YAML). Use UAV.all_from_args"
        )
    return _arguments_of(member, next(iter(member.argv.values())))


def _arguments_of(member: Membership, argv: Sequence[str], clock_of: ClockOf | None = None) -> dict[str, Any]:
    """Return the keyword arguments for `UAV` of one vehicle of a group.

    argv: `--uav FILE` and the program's own arguments.
    """
    given, others = _parser().parse_known_args(argv)
    found = _from_slice(given.uav, clock_of or (lambda stem, name: member.threads.clock(name)))
    return {**found, "args": others, "receiver": member.receiver}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--uav", metavar="FILE", help="JSON file with all settings, passed by the supervisor")
    parser.add_argument("--ns", help=f"name of the vehicle; by default {_DEFAULT_NS}")
    parser.add_argument("--id", type=int, help="its MAV_SYS_ID; by default the number at the end of its name")
    parser.add_argument("--link", help="udpin:HOST:PORT; by default udpin:127.0.0.1:16000+id")
    parser.add_argument("--profile", help="vehicle type; by default iris")
    parser.add_argument(
        "--clock", help="path of a simulation clock, without .page or .sock; the wall clock by default"
    )
    parser.add_argument(
        "--capture",
        metavar="VENDOR:ADDRESS",
        help=f"read the vehicle's pose from this motion capture; vendors: {', '.join(VENDORS)}",
    )
    parser.add_argument(
        "--backend",
        choices=("mavlink", "mavsdk"),
        help="library that sends setpoints and commands; by default mavlink",
    )
    parser.add_argument("--body", help="name of the vehicle's rigid body; by default the vehicle's name")
    return parser


def _from_slice(file: str, clock_of: ClockOf) -> dict[str, Any]:
    try:
        settings = json.loads(Path(file).read_text())
        return {
            **_profile(settings["profile"]),
            "ns": settings["vehicle"],
            "link": settings["link"],
            "system_id": settings["id"],
            "capture": settings.get("capture"),
            "body": settings.get("body"),
            "clock": clock_of(settings.get("clock"), settings["vehicle"]),
            "sensors": _sensors(settings),
            "stale_s": settings.get("stale_s", 0.5),
            "heartbeat": _address(settings.get("heartbeat", settings.get("heart"))),
            "log": _address(settings.get("log")),
            "run": settings.get("run"),
            "barriers": settings.get("barriers"),
            "programs": settings.get("programs", ()),
            "backend": settings.get("backend", "mavlink"),
        }
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"--uav {file}: {error}") from error
    except KeyError as error:
        raise InputError(f"--uav {file}: the key {error} is missing; `arena up` writes this file") from error


def _by_hand(given: argparse.Namespace, clock_of: ClockOf) -> dict[str, Any]:
    from arena.schema.library import load_profile  # only a program started by hand needs the profile files

    ns = given.ns or _DEFAULT_NS
    digits = ns[len(ns.rstrip("0123456789")) :]
    if given.id is None and not digits:
        raise InputError(f"--id: missing, and the name {ns!r} does not end in a number that could be the id")
    number = int(digits) if given.id is None else given.id
    profile = load_profile(given.profile or _DEFAULT_PROFILE).slice()
    link = given.link or f"udpin:127.0.0.1:{16000 + number}"
    return {
        **_profile(profile),
        "ns": ns,
        "link": link,
        "system_id": number,
        "clock": clock_of(given.clock, ns),
        "capture": _capture(given.capture, given.body or ns) if given.capture else None,
        "body": given.body,
        "backend": given.backend or "mavlink",
    }


def _capture(text: str, body: str) -> dict[str, Any]:
    """Parse the option `--capture`. Return the settings of a motion capture client for one rigid body.

    text: VENDOR:ADDRESS and the vendor's options.
    """
    vendor, _, rest = text.partition(":")
    try:
        return {**vendor_settings(vendor).parse_client(rest), "bodies": [body]}
    except InputError as error:
        raise InputError(f"--capture: {error}") from error


def _sensors(settings: Mapping[str, Any]) -> RelativeSensors:
    return RelativeSensors(
        neighbours={n["name"]: int(n["id"]) for n in settings.get("neighbours", ())},
        beacons={b["name"]: int(b["number"]) for b in settings.get("beacons", ())},
        neighbours_stale_s=float(settings.get("neighbours_stale_s", 0.5)),
        beacons_stale_s=float(settings.get("beacons_stale_s", 0.5)),
    )


def _address(address: Sequence[Any] | None) -> tuple[str, int] | None:
    return None if address is None else (str(address[0]), int(address[1]))


def _profile(profile: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "mass": profile["mass_kg"],
        "radius": profile["radius_m"],
        "height": profile["height_m"],
        "num_rotors": profile["num_rotors"],
        "thrust_curve": profile["thrust_curve"],
    }


def _clock(stem: str | None, name: str) -> SimClock | None:
    return SimClock(stem, name) if stem else None
