"""Command-line arguments of a user program: they select the vehicle that the program flies.

`arena up` passes a file with all settings; a user who starts the program by hand gives single options.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from arena.clock import Clock, SimClock
from arena.errors import InputError
from arena.mocap.vendors import VENDORS, vendor_settings
from arena.uav.membership import MEMBERSHIP, Membership


def read_arguments(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Parse the command line of a user program and return the keyword arguments for `UAV`. Raises InputError.

    argv: arguments without the program's name; None for those of this process.
    """
    member = MEMBERSHIP.get() if argv is None else None
    if member is not None:
        return _of_member(member)
    given, others = _parser().parse_known_args(argv)
    found = _from_slice(given.uav, _clock) if given.uav else _by_hand(given)
    return {**found, "args": others}


def read_group(member: Membership | None) -> list[dict[str, Any]]:
    """Return the keyword arguments for `UAV` of each vehicle of a group. Raises InputError if the program has no group."""
    if member is None or not member.once:
        raise InputError(
            "UAV.all_from_args: this program flies one vehicle. Use UAV.from_args, or write "
            "`program: {path: FILE.py, group: NAME, run: once}` in the YAML"
        )
    return [_arguments_of(member, argv) for argv in member.argv.values()]


def _of_member(member: Membership) -> dict[str, Any]:
    if member.once:
        raise InputError(
            "UAV.from_args: this program flies a whole group (`run: once` in the YAML). Use UAV.all_from_args"
        )
    return _arguments_of(member, next(iter(member.argv.values())))


def _arguments_of(member: Membership, argv: Sequence[str]) -> dict[str, Any]:
    """Return the keyword arguments for `UAV` of one vehicle of a group. argv: `--uav FILE` and the program's own arguments."""
    given, others = _parser().parse_known_args(argv)
    found = _from_slice(given.uav, lambda stem, name: member.threads.clock(name))
    return {**found, "args": others, "receiver": member.receiver}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--uav", metavar="FILE", help="JSON file with all settings, passed by the supervisor")
    parser.add_argument("--ns", default="uav1", help="name of the vehicle")
    parser.add_argument("--id", type=int, help="its MAV_SYS_ID; by default the number at the end of its name")
    parser.add_argument("--link", help="udpin:HOST:PORT; by default udpin:127.0.0.1:16000+id")
    parser.add_argument("--profile", default="iris", help="vehicle type")
    parser.add_argument(
        "--clock", help="path of a simulation clock, without .page or .sock; the wall clock by default"
    )
    parser.add_argument(
        "--capture",
        metavar="VENDOR:ADDRESS",
        help=f"read the vehicle's pose from this motion capture; vendors: {', '.join(VENDORS)}",
    )
    parser.add_argument("--body", help="name of the vehicle's rigid body; by default the vehicle's name")
    return parser


def _from_slice(file: str, clock_of: Callable[[str | None, str], Clock | None]) -> dict[str, Any]:
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
            "neighbours": [(n["name"], n["body"]) for n in settings.get("neighbours", ())],
            "stale_s": settings.get("stale_s", 0.5),
            "heartbeat": _address(settings.get("heartbeat", settings.get("heart"))),
            "log": _address(settings.get("log")),
            "run": settings.get("run"),
            "barriers": settings.get("barriers"),
            "programs": settings.get("programs", ()),
        }
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"--uav {file}: {error}") from error
    except KeyError as error:
        raise InputError(f"--uav {file}: the key {error} is missing; `arena up` writes this file") from error


def _by_hand(given: argparse.Namespace) -> dict[str, Any]:
    from arena.schema.library import load_profile  # only a program started by hand needs the profile files

    digits = given.ns[len(given.ns.rstrip("0123456789")) :]
    if given.id is None and not digits:
        raise InputError(
            f"--id: missing, and the name {given.ns!r} does not end in a number that could be the id"
        )
    number = int(digits) if given.id is None else given.id
    profile = load_profile(given.profile).slice()
    link = given.link or f"udpin:127.0.0.1:{16000 + number}"
    return {
        **_profile(profile),
        "ns": given.ns,
        "link": link,
        "system_id": number,
        "clock": _clock(given.clock, given.ns),
        "capture": _capture(given.capture, given.body or given.ns) if given.capture else None,
        "body": given.body,
    }


def _capture(text: str, body: str) -> dict[str, Any]:
    """Parse the option `--capture` and return the settings of a motion-capture client that receives one body.

    text: VENDOR:ADDRESS and the vendor's options.
    """
    vendor, _, rest = text.partition(":")
    try:
        return {**vendor_settings(vendor).parse_client(rest), "bodies": [body]}
    except InputError as error:
        raise InputError(f"--capture: {error}") from error


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
