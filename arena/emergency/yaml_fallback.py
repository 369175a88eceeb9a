"""Reader of vehicle names, ids and addresses from an arena.yaml, also if the file has errors.

It ignores everything else in the file.

No error in the file stops the reading.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from arena.transport import DEFAULT_BAUD, ConnectionUrl, parse_url

_MOST_DEPTH = 4
_LARGEST_ID = 255  # MAVLink system ids are 1 to 255


@dataclass(frozen=True, kw_only=True)
class VehicleEntry:
    """Name, MAVLink id and connection of one vehicle, as read from the YAML.

    connection: connection of a real vehicle, from its `url`; None for a simulated vehicle.
    uid: value of its key `uid`, the hardware uid of a real vehicle; None without this key
    key_file: file with the key of MAVLink signing, as written in the YAML; "" if there is none
    radio: false if the YAML has `radio: none` for the vehicle
    """

    name: str
    id: int
    connection: ConnectionUrl | None = None
    uid: Any = None
    key_file: str = ""
    radio: bool = True


def read_yaml(text: str, depth: int = _MOST_DEPTH) -> Any:
    """Return the parsed content of a YAML text. A block with errors becomes None.

    depth: levels of nested blocks that are read separately
    """
    import yaml  # imported late: not needed when a run's plan can be read

    try:
        return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, ValueError, RecursionError):
        return _blocks(text, depth) if depth else None


def vehicles_of(document: Any) -> tuple[str, list[VehicleEntry]]:
    """Return the vehicles of a YAML, and the IP address of their autopilots.

    The key `address` gives the IP address; the default is 127.0.0.1.

    The result is (address, vehicles). A vehicle without an id gets the lowest free id, in the order of the file.
    document: content of the YAML, from `read_yaml`
    """
    root = document if isinstance(document, dict) else {}
    vehicles = root.get("vehicles")
    vehicles = vehicles if isinstance(vehicles, dict) else {}
    given = {str(name): _id(keys) for name, keys in vehicles.items()}
    free = iter(i for i in range(1, 1000) if i not in given.values())
    connections = {str(name): _connection(root, keys) for name, keys in vehicles.items()}
    named = [
        VehicleEntry(
            name=name,
            id=number or next(free),
            connection=connections[name],
            uid=_uid(vehicles[name]),
            key_file=_key_file(vehicles[name]),
            radio=_merged(root, vehicles[name]).get("radio") != "none",
        )
        for name, number in given.items()
    ]
    return _address(root.get("address")), named


def _connection(root: dict[str, Any], keys: Any) -> ConnectionUrl | None:
    """Return a real vehicle's connection from its YAML keys or from `defaults`; None without a valid one."""
    own = _merged(root, keys)
    if own.get("autopilot", "hardware") != "hardware":
        return None
    baud = own.get("baud")
    try:
        return parse_url(
            str(own.get("url")), baud=baud if isinstance(baud, int) and baud > 0 else DEFAULT_BAUD
        )
    except ValueError:
        return None


def _merged(root: dict[str, Any], keys: Any) -> dict[str, Any]:
    """Return the YAML keys of a vehicle, completed with the arena's `defaults`."""
    defaults = root.get("defaults")
    return {**(defaults if isinstance(defaults, dict) else {}), **(keys if isinstance(keys, dict) else {})}


def _key_file(keys: Any) -> str:
    signing = keys.get("signing") if isinstance(keys, dict) else None
    file = signing.get("key_file") if isinstance(signing, dict) else None
    return file if isinstance(file, str) else ""


def _id(keys: Any) -> int | None:
    """Return the MAVLink system id that the YAML gives a vehicle, or None if it gives none.

    Every possible id is accepted, also one that `arena check` refuses: a vehicle must not get another vehicle's id.
    """
    number = keys.get("id") if isinstance(keys, dict) else None
    is_id = isinstance(number, int) and not isinstance(number, bool) and 1 <= number <= _LARGEST_ID
    return number if is_id else None


def _uid(keys: Any) -> Any:
    return keys.get("uid") if isinstance(keys, dict) else None


def _address(raw: Any) -> str:
    plain = isinstance(raw, str) and re.fullmatch(r"\d{1,3}(\.\d{1,3}){3}", raw, re.ASCII)
    return raw if plain and all(int(byte) < 256 for byte in raw.split(".")) else "127.0.0.1"


def _blocks(text: str, depth: int) -> dict[str, Any]:
    """Parse each outermost `key: ...` block of a YAML separately, so that an error loses one block only."""
    every = text.lstrip("\ufeff").expandtabs().splitlines()
    lines = [line for line in every if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        return {}
    outer = min(len(line) - len(line.lstrip()) for line in lines)
    found: dict[str, Any] = {}
    blocks: list[list[str]] = []
    for line in lines:
        if len(line) - len(line.lstrip()) == outer or not blocks:
            blocks.append([])
        blocks[-1].append(line[outer:])
    for block in blocks:
        key = re.match(r"""["']?([^\s"':#\[\]{}][^"':]*)["']?\s*:(?:\s|$)(.*)""", block[0])
        if key:
            found[key[1]] = _value(key[2], block[1:], depth)
    return found


def _value(rest: str, inner: list[str], depth: int) -> Any:
    """Return the value of a YAML key, from the text after the key and the lines below it.

    The value is on the line of the key, or on the lines below the key.

    rest: text after the key. inner: lines below the key
    """
    if rest.partition("#")[0].strip() or not inner:
        text = "\n".join([rest, *inner])
        return read_yaml(text, 0) if inner else _flow(rest)
    return read_yaml("\n".join(inner), depth - 1)


def _flow(rest: str) -> Any:
    """Parse a YAML value that is written on one line.

    If it is a flow mapping with errors, return only `id` and `url`, if these keys can be found.
    """
    value = read_yaml(rest, 0)
    if value is not None:
        return value
    number, url = re.search(r"\bid:\s*(\d+)", rest), re.search(r"""\burl:\s*["']?([^\s"',}]+)""", rest)
    found = {**({"id": int(number[1])} if number else {}), **({"url": url[1]} if url else {})}
    return found or None
