"""Faults on purpose in the world: one JSON object of `arena.fault_injection` -> a call of the world or its pilots. Pure."""

from __future__ import annotations

from collections.abc import Callable

from arena.errors import InputError
from arena.fault_injection import Fault, flag, number, plain, vector, whole, word
from arena.sim.autopilot_interface import Pilots
from arena.sim.world import World

_MOST_WIND_M_S = 50.0
_EMPTY_IN_S = (0.1, 1e6)


def spoil(world: World, pilots: Pilots, fault: Fault) -> str:
    """Do it -> what it is, in a few words. Raises InputError for one that makes no sense."""
    kinds: dict[str, Callable[[], str]] = {
        "motor": lambda: _motor(world, fault),
        "battery": lambda: _battery(world, fault),
        "wind": lambda: _wind(world, fault),
        "sticks": lambda: _sticks(world, pilots, fault),
    }
    return kinds[word(fault, "do", kinds)]()


def _motor(world: World, fault: Fault) -> str:
    name, row = _vehicle(world, fault)
    rotor = whole(fault, "rotor", 1, len(world.fleet.profiles[row]["rotors"]))
    share = number(fault, "thrust", 0.0, 1.0)
    world.weaken(row, rotor - 1, share)
    return f"rotor {rotor} of {name} gives {100.0 * share:g} % of its thrust"


def _battery(world: World, fault: Fault) -> str:
    name, row = _vehicle(world, fault)
    if "empty_in_s" in fault and fault["empty_in_s"] is None:
        world.drain(row, None)
        return f"the battery of {name} falls as its motors draw"
    empty_in_s = number(fault, "empty_in_s", *_EMPTY_IN_S)
    world.drain(row, empty_in_s)
    return f"the battery of {name} falls at the pace full to empty in {empty_in_s:g} s"


def _wind(world: World, fault: Fault) -> str:
    wind_n = vector(fault, "wind_m_s", _MOST_WIND_M_S)
    world.blow(wind_n)
    return f"wind {plain(wind_n)} m/s"


def _sticks(world: World, pilots: Pilots, fault: Fault) -> str:
    name, row = _vehicle(world, fault)
    on = flag(fault, "on")
    if not hasattr(pilots, "sticks"):
        raise InputError("the autopilots here know no sticks")
    pilots.sticks(row, on)
    return f"the sticks of {name} are {'heard' if on else 'lost'}"


def _vehicle(world: World, fault: Fault) -> tuple[str, int]:
    names = world.fleet.names
    name = word(fault, "vehicle", names)
    return name, names.index(name)
