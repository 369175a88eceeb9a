"""How a program learns which vehicle it flies: the supervisor's slice, or arguments typed by hand."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from arena.clock import SimClock
from arena.errors import InputError
from arena.mocap.vendors import VENDORS, vendor_settings


def read_arguments(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Keyword arguments of `UAV`. argv: without the program's name; None takes the process's own. Raises InputError."""
    known, others = _parser().parse_known_args(argv)
    found = _from_slice(known.uav) if known.uav else _by_hand(known)
    return {**found, "args": others}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(
        "--uav", metavar="FILE", help="what the supervisor passes: a JSON file that holds all the rest"
    )
    parser.add_argument("--ns", default="uav1", help="name of the vehicle")
    parser.add_argument("--id", type=int, help="its MAV_SYS_ID; by default the number that ends its name")
    parser.add_argument("--link", help="udpin:HOST:PORT; by default udpin:127.0.0.1:16000+id")
    parser.add_argument("--profile", default="iris", help="vehicle type")
    parser.add_argument("--clock", help="stem of a simulation clock; the wall clock by default")
    parser.add_argument(
        "--capture",
        metavar="VENDOR:ADDRESS",
        help=f"read the vehicle's pose from this motion capture; vendors: {', '.join(VENDORS)}",
    )
    parser.add_argument("--body", help="one's own name in the motion capture; by default the vehicle's name")
    return parser


def _from_slice(file: str) -> dict[str, Any]:
    try:
        settings = json.loads(Path(file).read_text())
        return {
            **_profile(settings["profile"]),
            "ns": settings["vehicle"],
            "link": settings["link"],
            "system_id": settings["id"],
            "capture": settings.get("capture"),
            "body": settings.get("body"),
            "clock": _clock(settings.get("clock"), settings["vehicle"]),
            "neighbours": [(n["name"], n["body"]) for n in settings.get("neighbours", ())],
            "stale_s": settings.get("stale_s", 0.5),
            "heart": _heart(settings.get("heart")),
        }
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"--uav {file}: {error}") from error
    except KeyError as error:
        raise InputError(f"--uav {file}: the key {error} is missing; `arena up` writes this file") from error


def _by_hand(known: argparse.Namespace) -> dict[str, Any]:
    from arena.schema.library import load_profile  # only a program started by hand needs the profiles' files

    digits = known.ns[len(known.ns.rstrip("0123456789")) :]
    if known.id is None and not digits:
        raise InputError(f"--id: missing, and the name {known.ns!r} does not end in a number to take it from")
    number = int(digits) if known.id is None else known.id
    profile = load_profile(known.profile).slice()
    link = known.link or f"udpin:127.0.0.1:{16000 + number}"
    return {
        **_profile(profile),
        "ns": known.ns,
        "link": link,
        "system_id": number,
        "clock": _clock(known.clock, known.ns),
        "capture": _capture(known.capture, known.body or known.ns) if known.capture else None,
        "body": known.body,
    }


def _capture(text: str, body: str) -> dict[str, Any]:
    """Return the settings of a motion-capture client for one body. text: VENDOR:ADDRESS and the vendor's options."""
    vendor, _, rest = text.partition(":")
    try:
        return {**vendor_settings(vendor).parse_client(rest), "bodies": [body]}
    except InputError as error:
        raise InputError(f"--capture: {error}") from error


def _heart(address: Sequence[Any] | None) -> tuple[str, int] | None:
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
