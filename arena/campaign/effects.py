"""Checks of the overrides of a campaign: each must reach a flight, and each setting must have an effect.

A setting without an effect would give equal flights, whose table shows values that were never flown.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import Any

from arena.builtin_parameters import effect_problem
from arena.campaign.design import Flight, overrides_of
from arena.campaign.sweep import Sweep
from arena.errors import InputError
from arena.schema import Arena
from arena.schema.loader import parse_scalar

_SEEDS = "the campaign sets it in each flight. Use `seeds`"
_FIXED = {
    ("world", "seed"): _SEEDS,
    ("mocap", "seed"): _SEEDS,
    ("sim", "speed"): "a campaign always flies as fast as possible",
    ("address",): "the campaign chooses a free address for each flight",
}
"""Keys that a campaign sets itself -> reason."""


def override_problem(override: str, vehicles: Collection[str] | None) -> str:
    """Return why an override cannot reach a flight, or "".

    override: a text such as `world.seed=3`.  vehicles: names of the arena's vehicles; None if they are not known.
    """
    key, _, value = override.partition("=")
    path = tuple(key.strip().split("."))
    for fixed, why in _FIXED.items():
        if path == fixed[: len(path)] and _has(parse_scalar(value), fixed[len(path) :]):
            return f"{'.'.join(fixed)} cannot be set: {why}."
    if vehicles is not None and len(path) > 2 and path[0] == "vehicles" and path[1] not in vehicles:
        return f"the arena has no vehicle {path[1]!r}. It has: {', '.join(vehicles)}."
    return ""


def _has(value: Any, path: Sequence[str]) -> bool:
    for part in path:
        if not isinstance(value, dict) or part not in value:
            return False
        value = value[part]
    return True


def without_effect(sweep: Sweep, first: Flight, arena: Arena, load: Callable[[Flight], Arena]) -> list[str]:
    """Return the settings with several values that all give the same arena.

    first: first flight of the campaign, and `arena` its arena.  load: returns the arena of a flight.
    """
    base = _effective(arena)
    return [
        name
        for name, setting in sweep.settings.items()
        if (others := _other_values(sweep, name, first))
        and all(
            _is_same(load, base, replace(first, overrides=_overrides(sweep, first, name, value)))
            for value in others
        )
    ]


def _is_same(load: Callable[[Flight], Arena], base: Arena, flight: Flight) -> bool:
    try:
        return _effective(load(flight)) == base
    except InputError:  # this value does not fit the others of the first flight, so it has an effect
        return False


def _other_values(sweep: Sweep, name: str, first: Flight) -> list[Any]:
    """Return the values of a setting that differ from its value in the first flight; of a range, both ends."""
    setting = sweep.settings[name]
    values = setting.values if setting.values is not None else (setting.max, setting.min)
    return [value for value in values if value != first.settings[name]]


def _overrides(sweep: Sweep, first: Flight, name: str, value: Any) -> tuple[str, ...]:
    varied = {**first.settings, name: value}
    return (
        *sweep.overrides,
        *(text for key, v in varied.items() for text in overrides_of(key, sweep.settings[key], v)),
    )


def _effective(arena: Arena) -> Arena:
    """Return an arena without the parameters that the built-in autopilot does not use, for comparisons."""
    vehicles = tuple(
        replace(v, own_params={k: x for k, x in v.own_params.items() if not effect_problem(k, x)})
        if v.autopilot == "builtin"
        else v
        for v in arena.vehicles
    )
    return replace(arena, vehicles=vehicles, origins={})
