"""List of the flights of a campaign, computed from its sweep file. Pure.

The same sweep gives the same flights with the same ids.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from arena.campaign.sampler import in_range, latin_hypercube, random_points, whole_numbers
from arena.campaign.sweep import LARGEST_CAMPAIGN, PLACEHOLDER, Setting, Sweep, Value, is_drawn
from arena.errors import InputError

# significant digits of values of a range, so that a value on the command line is the flown value
_DIGITS, _MOST_DIGITS = 6, 17


@dataclass(frozen=True, kw_only=True)
class Flight:
    """Flight of a campaign: its arena or scenario, its seed, and its values of the varied settings.

    id: hexadecimal digits computed from overrides and seed, so that a flight keeps its id when the sweep gets more flights.
    number: position in the campaign, from 1.
    kind: `arena` or `scenario`.  file: path of that file.
    settings: values of the varied settings.
    overrides: `key=value` texts, as `arena up --set`.
    wall_limit_s: wall time after which the flight of an arena is ended [s].
    """

    id: str
    number: int
    kind: str
    file: str
    seed: int
    settings: Mapping[str, Value]
    overrides: tuple[str, ...]
    wall_limit_s: float

    def as_json(self) -> dict[str, Any]:
        """Return the flight as a JSON-ready object."""
        return asdict(self)


def flights(sweep: Sweep) -> list[Flight]:
    """Return all flights of a campaign, such as 6 flights for 3 combinations of settings and 2 seeds.

    Raises InputError if there are too many flights, or if two of them are the same.
    """
    every = points(sweep)
    if len(every) * len(sweep.seeds) > LARGEST_CAMPAIGN:
        raise InputError(
            f"{sweep.file}: got {len(every) * len(sweep.seeds)} flights, expected at most {LARGEST_CAMPAIGN}: "
            "give fewer values, samples or seeds"
        )
    pairs = itertools.product(every, sweep.seeds)
    found = [_flight(sweep, number, point, seed) for number, (point, seed) in enumerate(pairs, start=1)]
    _refuse_equal(sweep, found)
    return found


def _refuse_equal(sweep: Sweep, found: Sequence[Flight]) -> None:
    """Raise InputError if two flights have the same id: they would fly in the same folder, and count twice."""
    first: dict[str, Flight] = {}
    for flight in found:
        if (same := first.setdefault(flight.id, flight)) is not flight:
            values = ", ".join(f"{name} {value}" for name, value in flight.settings.items())
            raise InputError(
                f"{sweep.file}: flights {same.number} and {flight.number} are the same ({values}). "
                "Give fewer samples or steps, or a larger range"
            )


def points(sweep: Sweep) -> list[dict[str, Value]]:
    """Return all combinations of the values of the settings that vary.

    Each combination of listed values is combined with each random sample.
    """
    listed = [name for name in sweep.settings if name not in sweep.drawn]
    grid = itertools.product(*(listed_values(sweep.settings[name]) for name in listed))
    samples = drawn_values(sweep)
    found = [
        dict(zip((*listed, *sweep.drawn), (*cell, *sample), strict=True))
        for cell in grid
        for sample in samples
    ]
    return [{name: point[name] for name in sweep.settings} for point in found]


def listed_values(setting: Setting) -> list[Value]:
    """Return all values of a setting that is not random, from its list or its range.

    They are the `values` in the sweep file, or `steps` values from `min` to `max`.
    """
    if setting.values is not None:
        return list(setting.values)
    low, high = _range(setting)
    if setting.integer:
        low, high = math.ceil(low), math.floor(high)
    values = in_range(np.linspace(0.0, 1.0, setting.steps or 2), low, high, setting.scale)
    return [round(v) if setting.integer else _short(v, low, high) for v in values.tolist()]


def drawn_values(sweep: Sweep) -> list[tuple[Value, ...]]:
    """Draw the values of all settings of a campaign that vary at random.

    Each sample is a tuple with one value per random setting. If no setting is drawn, return one empty tuple.
    """
    settings = [s for s in sweep.settings.values() if is_drawn(s)]
    if not settings:
        return [()]
    draw = latin_hypercube if sweep.sampling == "latin_hypercube" else random_points
    shares = draw(sweep.samples, len(settings), np.random.default_rng(sweep.sampling_seed))
    columns = [_column(setting, share) for setting, share in zip(settings, shares.T, strict=True)]
    return list(zip(*columns, strict=True))


def _column(setting: Setting, share: Any) -> list[Value]:
    low, high = _range(setting)
    if setting.integer:
        return [int(v) for v in whole_numbers(share, low, high, setting.scale)]
    return [_short(v, low, high) for v in in_range(share, low, high, setting.scale).tolist()]


def _range(setting: Setting) -> tuple[float, float]:
    if setting.min is None or setting.max is None:
        raise ValueError(
            "a setting of the sweep file has no `values`, and `min` or `max` is missing: add `values`, or `min` and `max`"
        )
    return setting.min, setting.max


def _short(value: float, low: float, high: float) -> float:
    """Round a value of a range, so that it is short in a command line.

    Values of a narrow range get more digits, because they differ only in their last digits.
    """
    narrow = math.log10(max(abs(low), abs(high)) / (high - low))
    digits = min(_DIGITS + max(0, math.floor(narrow)), _MOST_DIGITS)
    return min(max(float(f"{value:.{digits}g}"), low), high)


def overrides_of(name: str, setting: Setting, value: Value) -> tuple[str, ...]:
    """Return the YAML overrides that give one setting a value, such as `world.wind_m_s=[3.0, 0, 0]`.

    name: name of the setting.  setting: its entry in the sweep file.  value: value of the setting in the flight.
    Each text in the list `set` of the setting becomes an override, with the value in place of {}. Without `set`, the name
    of the setting is the key.
    """
    text = json.dumps(value, ensure_ascii=False)
    return tuple(t.replace(PLACEHOLDER, text) for t in setting.set) or (f"{name}={text}",)


def overrides_at(sweep: Sweep, point: Mapping[str, Value]) -> tuple[str, ...]:
    """Return all YAML overrides of a flight: those of the whole campaign, then those of its values.

    point: setting -> its value in the flight
    """
    varied = [o for name, value in point.items() for o in overrides_of(name, sweep.settings[name], value)]
    return (*sweep.overrides, *varied)


def _flight(sweep: Sweep, number: int, point: Mapping[str, Value], seed: int) -> Flight:
    overrides = overrides_at(sweep, point)
    return Flight(
        id=flight_id(overrides, seed),
        number=number,
        kind=sweep.kind,
        file=sweep.flown,
        seed=seed,
        settings=point,
        overrides=overrides,
        wall_limit_s=sweep.wall_limit_s,
    )


def flight_id(overrides: Sequence[str], seed: int) -> str:
    """Return the id of a flight, computed from its overrides and its seed.

    The id has 10 hexadecimal digits of a hash.
    """
    return hashlib.sha256(json.dumps([list(overrides), seed]).encode()).hexdigest()[:10]
