"""Reads of an arena.yaml only what landing needs, and refuses nothing: addresses of vehicles, whatever else is wrong."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from arena.emergency.direct_address import Wire, from_url

_MOST_DEPTH = 4


@dataclass(frozen=True, kw_only=True)
class Named:
    """A vehicle of the file. wire: of a real one, by its `url`."""

    name: str
    id: int
    wire: Wire | None = None


def read_yaml(text: str, depth: int = _MOST_DEPTH) -> Any:
    """The document; where it is broken, each block that can be read by itself, and None for one that cannot."""
    import yaml  # not where a run's plan is read

    try:
        return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, ValueError, RecursionError):
        return _blocks(text, depth) if depth else None


def vehicles_of(document: Any) -> tuple[str, list[Named]]:
    """(the arena's address, its vehicles): ids as written, the others the lowest free in order."""
    root = document if isinstance(document, dict) else {}
    vehicles = root.get("vehicles")
    vehicles = vehicles if isinstance(vehicles, dict) else {}
    given = {str(name): _id(keys) for name, keys in vehicles.items()}
    free = iter(i for i in range(1, 1000) if i not in given.values())
    wires = {str(name): _wire(root, keys) for name, keys in vehicles.items()}
    named = [Named(name=name, id=number or next(free), wire=wires[name]) for name, number in given.items()]
    return _address(root.get("address")), named


def _wire(root: dict[str, Any], keys: Any) -> Wire | None:
    """By its own keys, else by the defaults'."""
    defaults = root.get("defaults")
    own = {**(defaults if isinstance(defaults, dict) else {}), **(keys if isinstance(keys, dict) else {})}
    return (
        from_url(own.get("url"), own.get("baud")) if own.get("autopilot", "hardware") == "hardware" else None
    )


def _id(keys: Any) -> int | None:
    number = keys.get("id") if isinstance(keys, dict) else None
    return number if isinstance(number, int) and not isinstance(number, bool) and 1 <= number <= 250 else None


def _address(raw: Any) -> str:
    plain = isinstance(raw, str) and re.fullmatch(r"\d{1,3}(\.\d{1,3}){3}", raw, re.ASCII)
    return raw if plain and all(int(byte) < 256 for byte in raw.split(".")) else "127.0.0.1"


def _blocks(text: str, depth: int) -> dict[str, Any]:
    """The `key: ...` blocks at the outermost indentation, each read on its own."""
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
    """What stands behind `key:`: the lines below it, or else the rest of its own."""
    if rest.partition("#")[0].strip() or not inner:
        text = "\n".join([rest, *inner])
        return read_yaml(text, 0) if inner else _flow(rest)
    return read_yaml("\n".join(inner), depth - 1)


def _flow(rest: str) -> Any:
    """A value on one line. A broken flow mapping still gives its id and url."""
    value = read_yaml(rest, 0)
    if value is not None:
        return value
    number, url = re.search(r"\bid:\s*(\d+)", rest), re.search(r"""\burl:\s*["']?([^\s"',}]+)""", rest)
    found = {**({"id": int(number[1])} if number else {}), **({"url": url[1]} if url else {})}
    return found or None
