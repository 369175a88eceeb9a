"""Cross-checks of the keys of one vehicle: program, parameters, sensors.

The functions read files only through `Files`, which tests replace.
"""

from __future__ import annotations

import itertools
import re
import warnings
from collections.abc import Iterator
from pathlib import Path

from arena.errors import Problem
from arena.schema.arena import Vehicle
from arena.schema.checking import Check
from arena.schema.library import override_problems
from arena.schema.source import as_list, near

_PARAM = re.compile(r"[A-Z][A-Z0-9_]{0,15}")


def _gps_and_sticks(c: Check) -> Iterator[Problem]:
    """Check that `gps` and `sticks` are true only for autopilots that use them.

    `sticks` is a simulated RC transmitter.
    """
    for v in c.arena.vehicles:
        for key, fits in (("gps", ("px4", "hitl")), ("sticks", ("px4", "builtin"))):
            if getattr(v, key) and v.autopilot not in fits and c.sound(v, key, "autopilot"):
                said = f"got true, which is for autopilot: {' or '.join(fits)}, but {v.name} has {v.autopilot}. Remove the key."
                yield c.problem(v.name, (key,), said)


def _overrides(c: Check) -> Iterator[Problem]:
    """Check the mass and the sensor noise that replace values of a vehicle's profile.

    Sensor noise and wind are refused for real vehicles.
    """
    for v in c.arena.vehicles:
        if c.sound(v, "profile", "mass_kg", "sensors"):
            for keys, message in override_problems(v.profile, v.overrides):
                yield c.problem(v.name, keys, message)
        for key in ("sensors", "wind_m_s"):
            if c.source.given(("vehicles", v.name, key)) and not v.simulated:
                message = f"is for simulated vehicles, but {v.name} is hardware. Remove the key."
                yield c.problem(v.name, (key,), message)


def _programs(c: Check) -> Iterator[Problem]:
    for v in c.arena.vehicles:
        if v.program is None:
            if c.source.given(c.where(v.name, "args")) and c.sound(v, "program"):
                yield c.problem(v.name, ("args",), "is given without a program. Add `program`.")
            continue
        path = Path(v.program.path)
        if not c.files.is_file(str(path)):
            names = [n for n in c.files.names(str(path.parent)) if n.endswith(path.suffix or ".py")]
            hint = near(path.name, names) if names else f"Put it into {path.parent}."
            words = path.name.split()
            if len(words) > 1 and c.files.is_file(str(path.parent / words[0])):
                hint = f"Did you mean program: {words[0]}, args: {as_list(words[1:])}?"
            yield c.problem(
                v.name, ("program",), f"got {path.name!r}, expected a file in {path.parent}. {hint}"
            )
        elif path.suffix == ".py":
            yield from _syntax(c, v, path)
        elif not c.files.is_executable(str(path)):
            yield c.problem(
                v.name,
                ("program",),
                f"got {path.name!r}, expected a .py file or an executable. Try chmod +x {path}.",
            )


def _syntax(c: Check, v: Vehicle, path: Path) -> Iterator[Problem]:
    """Report syntax errors in a user's Python program before the arena starts.

    The program is compiled, but not run.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)
            compile(c.files.content(str(path)), str(path), "exec", dont_inherit=True)
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None)
        what = error.msg if isinstance(error, SyntaxError) else str(error)
        place = f"{path.name}:{line}" if line else path.name
        yield c.problem(v.name, ("program",), f"{place} is not valid Python: {what}. Correct the program.")
    except OSError as error:
        yield c.problem(v.name, ("program",), f"{path.name} cannot be read: {error.strerror}.")


def _bodies(c: Check) -> Iterator[Problem]:
    for a, b in itertools.combinations(c.arena.vehicles, 2):
        if a.mocap_body == b.mocap_body:
            said = f"got {b.mocap_body!r}, which is also the body of {a.name} ({c.place_of(a, 'mocap_body')})"
            yield c.problem(b.name, ("mocap_body",), f"{said}. Give each vehicle a body of its own.")


def _gcs(c: Check) -> Iterator[Problem]:
    for v in c.arena.vehicles:
        for i, address in enumerate(v.gcs):
            if address == c.arena.address:
                yield c.problem(
                    v.name,
                    ("gcs", i),
                    f"got {address}, the arena's own address, which always gets MAVLink. Remove it.",
                )
            elif address in v.gcs[:i]:
                yield c.problem(v.name, ("gcs", i), f"got {address} a second time. Remove it.")


def _params(c: Check) -> Iterator[Problem]:
    for v in c.arena.vehicles:
        for name in v.own_params:
            if not _PARAM.fullmatch(name):
                said = (
                    f"got {name!r}, expected a PX4 parameter name: at most 16 capital letters, digits and _"
                )
                yield c.problem(v.name, ("params", name), f"{said}. Try {name.upper()[:16]}.")
        if v.own_params.get("MAV_SYS_ID", v.id) != v.id:
            yield c.problem(
                v.name,
                ("params", "MAV_SYS_ID"),
                f"got {v.own_params['MAV_SYS_ID']:g}, but the vehicle's id is {v.id}. Write `id` instead.",
            )


VEHICLE = (_gps_and_sticks, _overrides, _programs, _bodies, _gcs, _params)
