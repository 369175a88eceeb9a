"""Reboot of vehicles after `arena params push`, and the check that they have kept the written values."""

from __future__ import annotations

import sys
import time
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from arena.cli._params_output import ending_text

if TYPE_CHECKING:
    from arena.params.transfer.session import PullReport, PushReport
    from arena.params.transfer.transfer import ParamResult
    from arena.params.transfer.transports import ParamTarget

SAVE_S = 2.5
"""Time in which PX4 saves written parameters: a delay of 0.3 s, and at most one save per 2 s [s]."""
REBOOT_BEGINS_S = 2.0
"""Time after which PX4 has obeyed the command to reboot, and its USB device has disappeared [s]."""
RETURN_LIMIT_S = 60.0
"""Time in which a rebooted vehicle must be found again [s]."""


def reboot_vehicles(
    targets: Mapping[str, ParamTarget],
    reports: Mapping[str, PushReport],
    *,
    real: Collection[str],
    without_asking: bool,
) -> bool:
    """Reboot the autopilots whose new values need a reboot; on a terminal, ask the user first.

    It waits until PX4 has saved the values. After the reboot it reads the values of real autopilots again.

    real: vehicles with a real autopilot. A simulated autopilot does not boot again.
    Return False if an autopilot still needs a reboot (it refuses, or the user did not agree), was not found again, or has lost
    a value.
    """
    wanted = {
        name: replace(targets[name], uid=report.uid or targets[name].uid)
        for name, report in reports.items()
        if report.needs_reboot and report.ending == "done"
    }
    question = f"reboot {', '.join(wanted)}, so that the new values take effect?"
    if not wanted:
        return True
    if not (without_asking or (sys.stdin.isatty() and typer.confirm(question))):
        for name in wanted:
            print(
                f"{name} needs a reboot before the new values take effect: {', '.join(reports[name].needs_reboot)}. "
                "Reboot it now. (A push with --reboot reboots it at the end)"
            )
        return False
    from arena.params.transfer.session import reboot as reboot_now

    time.sleep(SAVE_S)
    requested_at = time.monotonic()
    refusals = reboot_now(wanted)
    for name, refusal in refusals.items():
        if refusal:
            print(f"{name}: the autopilot did not reboot: {refusal}")
        else:
            print(f"{name}: rebooting", flush=True)
    rebooting = {name: wanted[name] for name in real if refusals.get(name) == ""}
    return _have_kept_values(rebooting, reports, requested_at) and not any(refusals.values())


def _have_kept_values(
    targets: Mapping[str, ParamTarget], reports: Mapping[str, PushReport], requested_at: float
) -> bool:
    """Find the rebooted vehicles again, and read the values that they had before the reboot. Print the result.

    requested_at: monotonic time of the command to reboot [s].
    Return whether every vehicle was found again and has kept all values.
    """
    if not targets:
        return True
    from arena.params.transfer.session import read_after_reboot

    held = {name: _held(reports[name]) for name in targets}
    time.sleep(REBOOT_BEGINS_S)
    found = read_after_reboot(
        targets,
        {name: list(values) for name, values in held.items()},
        requested_at=requested_at,
        limit_s=RETURN_LIMIT_S,
    )
    problems = {name: list(_problems(name, held[name], report)) for name, report in found.items()}
    for name, lines in problems.items():
        all_kept = f"{name}: has rebooted, and has kept all {len(held[name])} values"
        print("\n".join(lines) or all_kept)
    return not any(problems.values())


def _held(report: PushReport) -> dict[str, ParamResult]:
    """Return the parameters that had their wanted values at the end of the push."""
    return {name: result for name, result in report.results.items() if result.outcome in ("same", "written")}


def _not_found_text(after: PullReport) -> str:
    """Return why the values of a vehicle are unknown after the command to reboot."""
    if after.ending == "interrupted":
        return "the wait for the reboot was interrupted, so its values were not read again"
    if after.ending == "not rebooted":
        return f"has accepted the reboot, but has not rebooted within {RETURN_LIMIT_S:g} s"
    why = ending_text(after.ending, after.why)
    return f"not found again within {RETURN_LIMIT_S:g} s after the reboot, so its values were not read again ({why})"


def _problems(vehicle: str, held: Mapping[str, ParamResult], after: PullReport) -> Iterator[str]:
    """Yield one line per value that a rebooted vehicle has lost, or one line if it was not found again.

    held: parameter -> its result at the end of the push.
    after: what was read after the reboot.
    """
    from arena.wire.mavlink_params import alike

    if after.ending != "done":
        yield f"{vehicle}: {_not_found_text(after)}. Look at the vehicle and its connection, then run the same push again"
        return
    lost = 0
    for name, result in held.items():
        value, lacking = after.values.get(name), after.missing.get(name)
        if value is not None and alike(value.value, result.wanted, value.kind):
            continue
        lost += 1
        has = "sent no reply for it" if lacking == "unanswered" else "has no such parameter"
        has = has if value is None else f"has {value.value:g}"
        yield f"{vehicle}: {name}: after the reboot the vehicle {has}, wanted {result.wanted:g}"
    if lost:
        yield (
            f"{vehicle}: has lost {lost} of {len(held)} values in the reboot: it had not saved them, or its startup has "
            "changed them (airframe, SYS_AUTOCONFIG, extras.txt). Run the same push again"
        )
