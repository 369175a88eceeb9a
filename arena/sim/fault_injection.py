"""Fault injection in the simulated world, such as a failed rotor or an empty battery.

A fault is a JSON object (see `arena.fault_injection`). Pure.
"""

from __future__ import annotations

from collections.abc import Callable

from arena.errors import InputError
from arena.fault_injection import Fault, flag, number, plain, vector, whole, word
from arena.sim.autopilot_interface import AutopilotSet
from arena.sim.world import World

_MAX_WIND_M_S = 50.0
_EMPTY_IN_S = (0.1, 1e6)


def inject_fault(world: World, autopilots: AutopilotSet, fault: Fault) -> str:
    """Apply a fault and return a short description of it. Raises InputError if the fault is not valid."""
    kinds: dict[str, Callable[[], str]] = {
        "motor": lambda: _motor(world, fault),
        "battery": lambda: _battery(world, fault),
        "wind": lambda: _wind(world, fault),
        "sticks": lambda: _sticks(world, autopilots, fault),
    }
    return kinds[word(fault, "do", kinds)]()


def _motor(world: World, fault: Fault) -> str:
    name, row = _vehicle(world, fault)
    rotor = whole(fault, "rotor", 1, len(world.fleet.profiles[row]["rotors"]))
    share = number(fault, "thrust", 0.0, 1.0)
    world.scale_rotor_thrust(row, rotor - 1, share)
    return f"rotor {rotor} of {name} gives {100.0 * share:g} % of its thrust"


def _battery(world: World, fault: Fault) -> str:
    name, row = _vehicle(world, fault)
    if "empty_in_s" in fault and fault["empty_in_s"] is None:
        world.override_discharge(row, None)
        return f"the battery of {name} discharges according to its load again"
    empty_in_s = number(fault, "empty_in_s", *_EMPTY_IN_S)
    world.override_discharge(row, empty_in_s)
    return f"the battery drain of {name} is set to {100.0 / empty_in_s:.3g} %/s"


def _wind(world: World, fault: Fault) -> str:
    wind_n = vector(fault, "wind_m_s", _MAX_WIND_M_S)
    world.set_wind(wind_n)
    return f"wind {plain(wind_n)} m/s"


def _sticks(world: World, autopilots: AutopilotSet, fault: Fault) -> str:
    name, row = _vehicle(world, fault)
    on = flag(fault, "on")
    if not hasattr(autopilots, "sticks"):
        raise InputError("fault `sticks`: the autopilots of this world have no radio control")
    autopilots.sticks(row, on)
    return f"the radio control of {name} is {'on' if on else 'lost'}"


def _vehicle(world: World, fault: Fault) -> tuple[str, int]:
    names = world.fleet.names
    name = word(fault, "vehicle", names)
    return name, names.index(name)
