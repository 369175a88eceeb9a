"""Sweep file of a campaign: the arena to fly, the settings that vary, and the number of flights.

Unknown keys are refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from arena.campaign.measures import MEASURES
from arena.errors import InputError, Problem
from arena.schema.base import Positive, Strict
from arena.schema.loader import YamlPath, load_yaml
from arena.schema.source import Source, show, with_overrides
from arena.schema.validate import validate

PLACEHOLDER = "{}"
LARGEST_CAMPAIGN = 100_000
RESERVED = frozenset(
    {"id", "number", "seed", "passed", "reasons", "run", "wall_s"} | {m.name for m in MEASURES}
)
"""Names of columns in the table of results that no setting can have."""

Value = bool | int | float | str | tuple[Any, ...] | None
Scale = Literal["linear", "log"]
Sampling = Literal["latin_hypercube", "random"]


def _setting(value: Any) -> Any:
    if isinstance(value, tuple):
        return {"values": value}
    if isinstance(value, dict):
        return value
    raise ValueError("expected a list of values, or a mapping with `values`, or with `min` and `max`")


def _texts(value: Any) -> Any:
    return (value,) if isinstance(value, str) else value


def _seeds(value: Any) -> Any:
    if isinstance(value, int) and not isinstance(value, bool) and 1 <= value <= LARGEST_CAMPAIGN:
        return tuple(range(1, value + 1))
    if isinstance(value, tuple) and value and all(type(v) is int and 0 <= v < 2**32 for v in value):
        return tuple(dict.fromkeys(value))
    raise ValueError("expected the number of seeds (1, 2, ...), or a list of seeds")


class Setting(Strict):
    """Setting that varies over the campaign: given by `values`, or by `min` and `max`."""

    values: Annotated[tuple[Any, ...], Field(min_length=1)] | None = None
    """All values; each of them is flown."""
    min: float | None = None
    """Smallest value of a range."""
    max: float | None = None
    """Largest value of a range."""
    steps: Annotated[int, Field(ge=2, le=10_000)] | None = None
    """Number of values of the range, from `min` to `max` at equal distances; each of them is flown. Without `steps`, values are
    drawn: `samples` of them."""
    scale: Scale = "linear"
    """`log`: the logarithm of the value is distributed evenly."""
    integer: bool = False
    """Round the values of a range to integers."""
    set: Annotated[tuple[str, ...], BeforeValidator(_texts)] = ()
    """Overrides of the arena's YAML, with `{}` for the value, such as `world.wind_m_s=[{}, 0, 0]`. Default: the name of the
    setting is a dotted key of the YAML."""


class SweepFile(Strict):
    """Content of a sweep file. The user gives either `arena` or `scenario`."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=80)] | None = None
    """Name of the campaign. Default: name of the sweep file."""
    arena: str | None = None
    """Path of an arena's YAML, relative to the sweep file. A flight passes if `arena up --until-done` succeeds."""
    scenario: str | None = None
    """Path of a scenario file, relative to the sweep file. A flight passes if its scenario passes, as in `arena smoke`."""
    set: tuple[str, ...] = ()
    """Values that override the arena's YAML in every flight (as `arena up --set`)."""
    seeds: Annotated[tuple[int, ...], BeforeValidator(_seeds)] = (1,)
    """Number of seeds (8: seeds 1 to 8), or a list of seeds, of world and motion capture. Each point of the settings is
    flown once with each seed."""
    vary: dict[str, Annotated[Setting, BeforeValidator(_setting)]] = Field(default_factory=dict)
    """Settings that vary: a dotted key of the arena's YAML -> its values or its range."""
    samples: Annotated[int, Field(ge=1, le=LARGEST_CAMPAIGN)] | None = None
    """Number of points drawn from the ranges without `steps`. Required if there is such a range."""
    sampling: Sampling = "latin_hypercube"
    """How points are drawn. `latin_hypercube`: each range is divided into `samples` equal parts, and each part contains one point."""
    sampling_seed: Annotated[int, Field(ge=0, lt=2**32)] = 1
    """Seed of the drawn points. The same seed draws the same points."""
    wall_limit_s: Positive = 600.0
    """Wall time after which the flight of an arena is ended and fails [s]. A scenario has its own time limit."""
    cluster: str | None = None
    """Address of a Ray cluster that flies the campaign: HOST:PORT, or `auto`. Default: this computer alone."""


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Content of a sweep file that has passed all checks.

    file: path of the sweep file.
    source: the YAML with the line of each value, for messages.
    kind: `arena` or `scenario`; flown: path of that file.
    """

    file: str
    name: str
    kind: Literal["arena", "scenario"]
    flown: str
    overrides: tuple[str, ...]
    seeds: tuple[int, ...]
    settings: Mapping[str, Setting]
    samples: int
    sampling: Sampling
    sampling_seed: int
    wall_limit_s: float
    cluster: str | None
    source: Source

    @property
    def drawn(self) -> tuple[str, ...]:
        """Names of the settings whose values are drawn at random from a range."""
        return tuple(name for name, s in self.settings.items() if is_drawn(s))


def is_drawn(setting: Setting) -> bool:
    """Return whether the values of a campaign setting are drawn at random, from a range without `steps`."""
    return setting.values is None and setting.steps is None


def load_sweep(path: str | Path) -> Sweep:
    """Load a sweep file.

    Raises InputError with every problem of the file, each with its line.
    """
    document = load_yaml(path, start="`arena:` or `scenario:`, and `vary:`")
    source = with_overrides(document, ())
    found = validate(SweepFile, source)
    problems = list(found.problems)
    if found.model is not None:
        problems += _problems(found.model, source, {p for p in found.pruned})
    if problems or found.model is None:
        raise InputError(sorted(dict.fromkeys(problems), key=lambda p: (p.file, p.line)))
    model = found.model
    flown = model.arena or model.scenario or ""
    return Sweep(
        file=str(path),
        name=model.name or Path(path).name.split(".")[0],
        kind="arena" if model.arena else "scenario",
        flown=str(Path(path).parent / flown),
        overrides=model.set,
        seeds=model.seeds,
        settings=model.vary,
        samples=model.samples or 1,
        sampling=model.sampling,
        sampling_seed=model.sampling_seed,
        wall_limit_s=model.wall_limit_s,
        cluster=model.cluster,
        source=source,
    )


def _problems(model: SweepFile, source: Source, pruned: set[YamlPath]) -> Iterator[Problem]:
    """Yield the problems of a sweep file that come from a combination of keys, such as `samples` without a range.

    pruned: paths of the wrong values that were removed, and whose problems are already known. They cause no second problem.
    """
    if (model.arena is None) == (model.scenario is None) and not {("arena",), ("scenario",)} & pruned:
        got = "both" if model.arena else "neither"
        at: YamlPath = ("scenario",) if model.arena else ()
        yield source.problem(at, f"got {got}, expected `arena` or `scenario`: the file that is flown.")
    drawn = [name for name, s in model.vary.items() if is_drawn(s) and None not in (s.min, s.max)]
    if drawn and model.samples is None and ("samples",) not in pruned:
        said = "is missing: the number of values drawn from this range. Or give the range `steps`."
        yield source.problem(("samples",), said, at=("vary", drawn[0]))
    if model.samples is not None and not drawn and not pruned:
        yield source.problem(
            ("samples",), "no range to draw from. Give a setting `min` and `max`, without `steps`."
        )
    for name, setting in model.vary.items():
        for key, said in _of_setting(name, setting):
            path: YamlPath = ("vary", name, key) if key else ("vary", name)
            if path not in pruned:
                yield source.problem(path, said)


def _of_setting(name: str, s: Setting) -> Iterator[tuple[str, str]]:
    """Yield (key, message) for the problems of one setting."""
    if name in RESERVED:
        yield "", "is a column of the results. Choose another name."
    if s.values is not None and (s.min is not None or s.max is not None):
        yield "", "got `values` and a range, expected one of them."
    elif s.values is None and (s.min is None or s.max is None):
        yield "", "expected `values`, or `min` and `max`."
    if s.values is not None:
        for key in ("steps", "integer", "scale"):
            if key in s.model_fields_set:
                yield key, "is only for a range, and this setting has `values`."
        if len({show(v) for v in s.values}) < len(s.values):
            yield "values", "contains a value twice. Use `seeds` to repeat flights."
    elif s.min is not None and s.max is not None:
        yield from _of_range(s, s.min, s.max)
    yield from (("set", said) for text in s.set if (said := _template_problem(text)))


def _of_range(s: Setting, low: float, high: float) -> Iterator[tuple[str, str]]:
    if low >= high:
        yield "max", f"got {high:g}, expected more than `min` ({low:g})."
    elif s.scale == "log" and low <= 0:
        yield "min", f"got {low:g}, expected more than 0, because `scale` is log."
    elif s.integer and (count := math.floor(high) - math.ceil(low) + 1) < (s.steps or 1):
        key, got = ("steps", f"got {s.steps}") if s.steps else ("max", f"got {high:g}")
        yield key, f"{got}, but the range has only {count} integers."


def _template_problem(text: str) -> str:
    key, equals, value = text.partition("=")
    if not equals or not key.strip() or PLACEHOLDER not in value:
        return f"got {text!r}, expected key=value with {PLACEHOLDER} for the value, such as world.wind_m_s=[{PLACEHOLDER}, 0, 0]."
    return ""
