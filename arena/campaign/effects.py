"""Checks of the overrides of a campaign: each override and each setting must have an effect.

A setting without an effect would give equal flights, whose table shows values that were never flown.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from arena.builtin_parameters import effect_problem
from arena.campaign.design import Flight, overrides_at
from arena.campaign.sweep import Sweep, Value
from arena.errors import InputError
from arena.schema import Arena
from arena.schema.loader import parse_scalar

_Settings = Mapping[str, Value]
_SEEDS = "the campaign sets it in each flight. Use `seeds`"
_FIXED = {
    ("world", "seed"): _SEEDS,
    ("mocap", "seed"): _SEEDS,
    ("sim", "speed"): "a campaign always flies as fast as possible",
    ("address",): "the campaign chooses a free address for each flight",
}
"""Keys that a campaign sets itself -> reason."""


def override_problem(override: str, vehicles: Collection[str] | None) -> str:
    """Return why an override has no influence on a flight, or "".

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


def without_effect(sweep: Sweep, first: Flight, load: Callable[[Flight], Arena]) -> list[str]:
    """Return the settings with several values that all give the same arena.

    first: first flight of the campaign.  load: returns the arena of a flight.
    """

    def arena_at(settings: _Settings) -> Arena:
        return _effective(load(replace(first, settings=settings, overrides=overrides_at(sweep, settings))))

    return [
        name
        for name in sweep.settings
        if _with_other_value(sweep, name, first.settings)
        and not any(
            _has_effect(sweep, name, settings, arena_at) for settings in _corners(sweep, name, first.settings)
        )
    ]


def _corners(sweep: Sweep, name: str, first: _Settings) -> Iterator[_Settings]:
    """Yield the settings of the first flight, then with each other value of one further setting, such as the autopilot.

    name: setting that keeps its value.
    """
    yield first
    for other in sweep.settings:
        if other != name:
            yield from _with_other_value(sweep, other, first)


def _has_effect(sweep: Sweep, name: str, settings: _Settings, arena_at: Callable[[_Settings], Arena]) -> bool:
    """Return whether a setting has an effect: with another value of it, the arena changes or cannot be loaded.

    name: the setting.  settings: values of all settings.
    """
    try:
        base = arena_at(settings)
        return any(arena_at(changed) != base for changed in _with_other_value(sweep, name, settings))
    except InputError:  # the values of two settings do not fit together, so they matter
        return True


def _with_other_value(sweep: Sweep, name: str, settings: _Settings) -> list[_Settings]:
    """Return copies of the settings, each with another value of one setting. Of a range, both ends are used.

    name: setting whose value differs.
    """
    setting = sweep.settings[name]
    values = setting.values if setting.values is not None else (setting.max, setting.min)
    return [{**settings, name: value} for value in values if value != settings[name]]


def _effective(arena: Arena) -> Arena:
    """Return an arena without the parameters that the built-in autopilot does not use, for comparisons."""
    vehicles = tuple(
        replace(v, own_params={k: x for k, x in v.own_params.items() if not effect_problem(k, x)})
        if v.autopilot == "builtin"
        else v
        for v in arena.vehicles
    )
    return replace(arena, vehicles=vehicles, origins={})
