"""Rules for battery parameters: PX4 must measure the battery, and must land if the battery is low. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from arena.params.checks.findings import CheckContext, Finding
from arena.params.checks.link_loss import current_action

_MIN_CELL_V = 3.2  # voltage of a lithium polymer cell under load, below which the voltage collapses


def low_battery(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding if a low battery causes only a warning, or no reaction of PX4."""
    name, expected = "COM_LOW_BAT_ACT", "2 (land)"
    action, fix = current_action(ctx, "low_battery"), f"set {name} 2 (land)"
    if action == "warn":
        problem = "a low battery causes a warning, but no reaction"
        yield ctx.finding(
            "warning",
            name,
            problem,
            expected=expected,
            why="the vehicle flies until the battery is empty, and falls",
            fix=fix,
        )
    elif (
        action is None and ctx.value(name) != 1
    ):  # the value 1 still works, although newer versions do not list it
        problem = "no action for a low battery"
        yield ctx.finding(
            "error", name, problem, expected=expected, why="an empty battery causes no reaction", fix=fix
        )


def battery_thresholds(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding for each battery threshold of PX4 that has no effect.

    A threshold must be below the next higher threshold and above 0.
    """
    low, critical, emergency = (ctx.value(f"BAT_{n}_THR") for n in ("LOW", "CRIT", "EMERGEN"))
    if low is None or critical is None or emergency is None:
        return
    if critical <= 0 and emergency <= 0:
        yield ctx.finding(
            "error",
            "BAT_CRIT_THR",
            "the battery failsafe is never reached",
            expected="above 0",
            why="the charge is never below 0",
            fix="set BAT_CRIT_THR 0.1",
            related=("BAT_EMERGEN_THR",),
        )
    elif emergency >= critical:
        yield ctx.finding(
            "warning",
            "BAT_EMERGEN_THR",
            f"not below BAT_CRIT_THR {critical:g}",
            expected=f"below {critical:g}",
            why="the critical threshold has no effect: the emergency action comes first",
            fix=f"choose BAT_EMERGEN_THR below {critical:g}",
            related=("BAT_CRIT_THR",),
        )
    if critical >= low:
        yield ctx.finding(
            "warning",
            "BAT_CRIT_THR",
            f"not below BAT_LOW_THR {low:g}",
            expected=f"below {low:g}",
            why="there is no warning before the failsafe acts",
            fix=f"choose BAT_CRIT_THR below {low:g}",
            related=("BAT_LOW_THR",),
        )


def battery_is_measured(ctx: CheckContext) -> Iterator[Finding]:
    """Yield a finding for each parameter that prevents PX4 from estimating the battery's charge."""
    prefix = "BAT1_" if ctx.minor >= 11 else "BAT_"
    empty, charged = ctx.value(f"{prefix}V_EMPTY"), ctx.value(f"{prefix}V_CHARGED")
    source, cells = ctx.value(f"{prefix}SOURCE"), ctx.value(f"{prefix}N_CELLS")
    if source == -1:
        yield ctx.finding(
            "error",
            f"{prefix}SOURCE",
            "no battery is measured",
            expected="0 (power module) or 1 (smart battery)",
            why="the battery failsafe is never reached",
            fix=f"set {prefix}SOURCE 0",
        )
    if source in (1, -1):  # a smart battery reports its charge
        return
    if cells is not None and cells <= 0:
        yield ctx.finding(
            "error",
            f"{prefix}N_CELLS",
            "the number of cells is not set",
            expected="the battery's cells in series, such as 4",
            why="PX4 cannot estimate the charge from the voltage: the battery failsafe is never reached",
            fix=f"set {prefix}N_CELLS to the battery's cells in series",
        )
    if empty is None or charged is None:
        return
    if empty >= charged:
        yield ctx.finding(
            "error",
            f"{prefix}V_EMPTY",
            f"not below {prefix}V_CHARGED {charged:g} V",
            expected=f"below {charged:g} V",
            why="PX4 cannot estimate the charge from the voltage",
            fix=f"set {prefix}V_EMPTY 3.6",
            related=(f"{prefix}V_CHARGED",),
        )
    elif empty < _MIN_CELL_V:
        yield ctx.finding(
            "warning",
            f"{prefix}V_EMPTY",
            f"a cell counts as empty at {empty:g} V",
            expected=f"{_MIN_CELL_V:g} V or more",
            why="the voltage collapses before: the battery failsafe comes too late",
            fix=f"set {prefix}V_EMPTY 3.6",
        )
