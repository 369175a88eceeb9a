"""Reads of an arena.yaml only what landing needs, and refuses nothing: addresses of vehicles, whatever else is wrong."""

from __future__ import annotations

import re
from typing import Any

import yaml

_MOST_DEPTH = 4


def read_yaml(text: str, depth: int = _MOST_DEPTH) -> Any:
    """The document; where it is broken, each block that can be read by itself, and None for one that cannot."""
    try:
        return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (yaml.YAMLError, ValueError, RecursionError):
        return _blocks(text, depth) if depth else None


def vehicles_of(document: Any) -> tuple[str, list[tuple[str, int]]]:
    """(the arena's address, [(vehicle, id)]): ids as written, the others the lowest free in order."""
    root = document if isinstance(document, dict) else {}
    vehicles = root.get("vehicles")
    vehicles = vehicles if isinstance(vehicles, dict) else {}
    given = {str(name): _id(keys) for name, keys in vehicles.items()}
    free = iter(i for i in range(1, 1000) if i not in given.values())
    address = root.get("address")
    return _address(address), [(name, number or next(free)) for name, number in given.items()]


def _id(keys: Any) -> int | None:
    number = keys.get("id") if isinstance(keys, dict) else None
    return number if isinstance(number, int) and not isinstance(number, bool) and 1 <= number <= 250 else None


def _address(raw: Any) -> str:
    return raw if isinstance(raw, str) and re.fullmatch(r"\d{1,3}(\.\d{1,3}){3}", raw) else "127.0.0.1"


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
    """A value on one line. A broken flow mapping still gives its id and address."""
    value = read_yaml(rest, 0)
    if value is None and (number := re.search(r"\bid:\s*(\d+)", rest)):
        return {"id": int(number[1])}
    return value
