"""Rules for single parameters: unknown names, renamed parameters, types and ranges. Pure."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping

from arena.constants import INT32_MAX, INT32_MIN
from arena.params.checks.findings import CheckContext, Finding
from arena.params.facts.parameter_changes import CHANGES, Change, changes, convert
from arena.params.facts.parameter_table import Parameter, Version, parameters, versions

_MAV_PARAM_TYPE = {"INT32": "6 (INT32)", "FLOAT": "9 (FLOAT)"}


def unknown_names(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding for each given parameter that does not exist, or has no effect, in this PX4 version.

    The finding suggests the parameter's newer or older name, or the most similar name.
    """
    for name, value in ctx.given.items():
        change = _change_before(name, ctx)
        if change is not None and value != ctx.default(name):
            yield _replaced(name, value, change, ctx)
        elif change is None and name not in ctx.table:
            yield _of_another_version(name, value, ctx) or _misspelt(name, value, ctx)


def _change_before(name: str, ctx: CheckContext) -> Change | None:
    """Return the latest PX4 change that left a parameter without effect; None without such a change.

    The change was made in the vehicle's PX4 version or before: PX4 has removed, renamed or redefined the
    parameter.
    """
    done = [c for c in CHANGES if c.old == name and c.since <= ctx.minor and name not in c.new]
    return done[-1] if done and (done[-1].still_defined or name not in ctx.table) else None


def _replaced(name: str, value: float, change: Change, ctx: CheckContext) -> Finding:
    before = Version(1, change.since - 1)
    new = convert({name: value}, before, ctx.version).values if math.isfinite(value) else {}
    since = f"PX4 1.{change.since}"
    problem = f"no effect since {since}" if name in ctx.table else f"removed in {since}"
    if new:
        held = [n for n in new if n in ctx.given]
        already = f" ({', '.join(held)} already given)" if held else ""
        default = ctx.default(name)
        keep = "" if default is None else f", and leave {name} at its default {default:g}"
        return Finding(
            "warning" if held else "error",
            name,
            value,
            f"{_listed(new)} instead",
            problem,
            change.note,
            f"set {_listed(new)}{already}{keep}",
        )
    if change.new:
        names = " and ".join(change.new)
        fix = f"choose a value for {names}"
        return Finding("error", name, value, f"{names} instead", problem, change.note, fix)
    return Finding(
        "warning", name, value, "no such parameter", problem, change.note, f"remove {name} from the file"
    )


def _of_another_version(name: str, value: float, ctx: CheckContext) -> Finding | None:
    """Return a finding if a parameter exists only in older or newer PX4 versions, else None."""
    having = [version for version in versions() if name in parameters(version)]
    later = [version for version in having if version.minor > ctx.minor]
    if later:
        first = later[0]
        old = [c.old for c in changes(ctx.version, first) if name in c.new and c.old != name]
        names = " and ".join(dict.fromkeys(old))
        return Finding(
            "error",
            name,
            value,
            f"{names} instead" if names else "no such parameter",
            f"added in PX4 {first}",
            f"PX4 {ctx.version} does not have this parameter",
            f"use {names}" if names else f"remove {name}, or fly PX4 {first} or newer",
        )
    if having:
        why = f"PX4 {ctx.version} does not have this parameter, and no parameter is known to replace it"
        problem = f"removed after PX4 {having[-1]}"
        return Finding(
            "warning", name, value, "no such parameter", problem, why, f"remove {name} from the file"
        )
    return None


def _misspelt(name: str, value: float, ctx: CheckContext) -> Finding:
    problem = f"not a parameter of any PX4 version from {versions()[0]} to {versions()[-1]}"
    why = f"PX4 {ctx.version} ignores or refuses a parameter that it does not have"
    near = nearest_name(name, ctx.version)
    if near:
        return Finding(
            "error", name, value, f"perhaps {near}", problem, why, f"write {near} if you mean this parameter"
        )
    fix = f"remove {name}, unless a module of your own PX4 build defines it"
    return Finding("warning", name, value, "a parameter of PX4", problem, why, fix)


def nearest_name(name: str, version: Version) -> str:
    """Return the most similar parameter name that PX4 has; "" if no name is similar.

    Names of this PX4 version come first, then names of all versions.
    """
    every = {known for each in versions() for known in parameters(each)}
    for names in (parameters(version).keys(), every):
        if found := difflib.get_close_matches(name.upper(), names, n=1, cutoff=0.85):
            return found[0]
    return ""


def types_and_ranges(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding for each value with a wrong type or outside PX4's limits.

    A type in the file that differs from PX4's type is a finding, too.
    """
    for name, value in ctx.given.items():
        p = ctx.table.get(name)
        if p is None:
            continue
        if wrong := _type_error(value, p):
            expected, problem, why = wrong
            fix = f"set {name} to such a number; its default is {p.default:g}"
            yield Finding("error", name, value, expected, problem, why, fix)
        elif ctx.types.get(name, p.type) != p.type:
            yield Finding(
                "error",
                name,
                value,
                f"the type {p.type}",
                f"written with the type {ctx.types[name]}",
                "PX4 reads the bytes of one type as the other",
                f"write the type {_MAV_PARAM_TYPE[p.type]} in the last column",
            )
        elif not _within(value, p) and not _checked_elsewhere(name):
            past = [c.note for c in CHANGES if c.old == name and name in c.new and c.since <= ctx.minor]
            yield Finding(
                "warning",
                name,
                value,
                _limits(p),
                "outside its range",
                past[-1] if past else "PX4 accepts the value, but was not designed for it",
                f"choose {name} {_limits(p)}; the default is {p.default:g}",
            )


def _type_error(value: float, p: Parameter) -> tuple[str, str, str] | None:
    """Return (expected, problem, reason) if a value does not fit the type of its parameter, else None."""
    if not math.isfinite(value):
        return (
            "a finite number",
            "not a finite number",
            "values that PX4 computes from it are not finite either",
        )
    if p.type == "INT32" and value != int(value):
        return "an integer", "not an integer", "the parameter is an INT32"
    if p.type == "INT32" and not INT32_MIN <= value <= INT32_MAX:
        limits = f"{INT32_MIN} to {INT32_MAX}"
        return limits, "too large for its type", f"the parameter is an INT32, whose range is {limits}"
    return None


def _within(value: float, p: Parameter) -> bool:
    """Return whether a value is within PX4's limits, with a tolerance for 32-bit rounding."""
    slack = 0.0 if p.type == "INT32" else 1e-6 * max(abs(value), 1e-6)
    return (p.min is None or value >= p.min - slack) and (p.max is None or value <= p.max + slack)


def _checked_elsewhere(name: str) -> bool:
    """Return whether `types_and_ranges` skips the comparison of this parameter with PX4's limits.

    Circuit breakers have their own rule. Counters of flight time can exceed their limits.
    """
    return name.startswith(("CBRK_", "LND_FLIGHT_T_"))


def _limits(p: Parameter) -> str:
    low, high = ("" if end is None else f"{end:g}" for end in (p.min, p.max))
    unit = f" {p.unit}" if p.unit else ""
    if low and high:
        return f"{low} to {high}{unit}"
    return f"{low}{unit} or more" if low else f"up to {high}{unit}"


def _listed(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.7g}" for name, value in values.items())
