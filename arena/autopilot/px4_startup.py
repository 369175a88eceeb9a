"""Reader of PX4 startup scripts, for the PX4 stand-in (built-in autopilot in place of PX4 SITL).

Only the lines that the stand-in needs are supported.

Supported lines: `. FILE`, `param set NAME VALUE`, `param set-default NAME VALUE`, `simulator_mavlink start`
and `mavlink start`. `mavlink stream` is ignored, because the built-in autopilot has its own rates. Every
other line is reported as skipped.
"""

from __future__ import annotations

import itertools
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from arena.errors import InputError

Address = tuple[str, int]
LINKS = ("router", "vision", "panic", "ground")
"""Names of the links, in the order in which the scripts open them."""
_LOOPBACK = "127.0.0.1"
_ENV = "PX4_PARAM_"


@dataclass(frozen=True, kw_only=True)
class UdpLink:
    """MAVLink link over UDP that a startup script opens.

    local: local port
    remote: address to which the link sends
    """

    name: str
    local: int
    remote: Address


@dataclass(kw_only=True)
class Startup:
    """Settings from the startup scripts: simulator address, MAVLink links and parameters.

    simulator: address of the simulator API
    links: MAVLink links
    params: parameter values by PX4 name
    skipped: lines that are not supported
    """

    simulator: Address | None = None
    links: list[UdpLink] = field(default_factory=list)
    params: dict[str, float] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)


def read_startup(script: Path, env: Mapping[str, str]) -> Startup:
    """Read a startup script and the files that it sources.

    Raises InputError if a file is missing, a value is not a number, or no simulator is given.

    script: path of the first script; sourced files are in the same folder
    env: environment; PX4_PARAM_<NAME>=VALUE sets a parameter that `set-default` does not override
    """
    found = Startup(
        params={k.removeprefix(_ENV): _number(k, v) for k, v in env.items() if k.startswith(_ENV)}
    )
    for line in _lines(script):
        _run_line(found, line)
    if found.simulator is None:
        raise InputError(
            f"{script}: the line `simulator_mavlink start` is missing, so the address of the simulator "
            "is unknown. Add the line to the script."
        )
    return found


def _lines(script: Path) -> Iterator[list[str]]:
    """Yield each line of the script and of the files that it sources, split into words."""
    try:
        text = script.read_text()
    except OSError as error:
        raise InputError(f"{script}: cannot be read: {error.strerror}") from error
    for line in text.splitlines():
        words = shlex.split(line, comments=True)
        if words[:1] == ["."]:
            yield from _lines(script.parent / " ".join(words[1:]))
        elif words:
            yield words


def _run_line(found: Startup, words: list[str]) -> None:
    match words:
        case ["param", "set", name, value]:
            found.params[name] = _number(name, value)
        case ["param", "set-default", name, value]:
            found.params.setdefault(name, _number(name, value))
        case ["simulator_mavlink", "start", "-c", port]:
            found.simulator = (_LOOPBACK, _port(port))
        case ["simulator_mavlink", "start", "-t", host, port]:
            found.simulator = (host, _port(port))
        case ["mavlink", "start", *options]:
            _open(found, options)
        case ["mavlink", "stream", *_]:
            pass
        case _:
            found.skipped.append(" ".join(words))


def _open(found: Startup, options: Sequence[str]) -> None:
    given = {flag: value for flag, value in itertools.pairwise(options) if flag in ("-u", "-t", "-o")}
    if len(given) != 3 or len(found.links) == len(LINKS):
        found.skipped.append(f"mavlink start {' '.join(options)}")
        return
    remote = (given["-t"], _port(given["-o"]))
    found.links.append(UdpLink(name=LINKS[len(found.links)], local=_port(given["-u"]), remote=remote))


def rotors(params: Mapping[str, float]) -> list[dict[str, Any]]:
    """Return position and spin direction of each rotor, from the CA_ROTOR* parameters.

    The form is the same as in a vehicle profile.

    A rotor with positive KM turns counter-clockwise. Raises InputError if no rotor is defined.
    """
    count = int(params.get("CA_ROTOR_COUNT", 0))
    if count < 1:
        raise InputError(
            "CA_ROTOR_COUNT is not given: set the environment variables PX4_PARAM_CA_ROTOR_COUNT, "
            "and PX4_PARAM_CA_ROTOR<i>_PX, _PY and _KM for each rotor i"
        )
    try:
        return [
            {
                "position_m": [params[f"CA_ROTOR{i}_PX"], params[f"CA_ROTOR{i}_PY"], 0.0],
                "direction": "ccw" if params[f"CA_ROTOR{i}_KM"] > 0.0 else "cw",
            }
            for i in range(count)
        ]
    except KeyError as error:
        raise InputError(
            f"{error.args[0]} is not given: set the environment variable PX4_PARAM_{error.args[0]}"
        ) from error


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{name}: got {text!r}, expected a number") from None


def _port(text: str) -> int:
    if not text.isdecimal() or not 0 < int(text) < 65536:
        raise InputError(f"startup script: got {text!r}, expected a port number (1 .. 65535)")
    return int(text)
