"""Reboots vehicles after `arena params push`, checks that they have kept their values, and records missing reboots."""

from __future__ import annotations

import sys
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from arena.cli._params import writable
from arena.cli._params_output import ending_text

if TYPE_CHECKING:
    from arena.missing_reboots import ClockTime, MissingReboot
    from arena.params.transfer.push_record import PushRecord
    from arena.params.transfer.session import PullReport, PushReport
    from arena.params.transfer.transfer import ParamResult
    from arena.params.transfer.transports import ParamTarget

SAVE_S = 2.5
"""Longest time until PX4 has saved a written parameter [s]. PX4 saves 0.3 s after a write, but at most once per 2 s."""
REBOOT_BEGINS_S = 2.0
"""Time from the reboot command until the old firmware no longer sends and its USB device is gone [s]."""
RETURN_LIMIT_S = 60.0
"""Time in which a rebooted vehicle must be found again [s]."""


class RebootsOfPush:
    """Missing reboots of the vehicles of one push: those of this push, and those of earlier pushes.

    folder: folder of the YAML, in which the missing reboots are kept.
    addresses: vehicle -> address as text, for the vehicles with a real autopilot. Simulated autopilots are not recorded: the
        arena sets their values at each start.
    Raises InputError if the file of the missing reboots is wrong.
    """

    def __init__(self, folder: Path, addresses: Mapping[str, str]) -> None:
        from arena.missing_reboots import MissingReboots

        self._earlier, self._addresses = MissingReboots.read(folder), addresses
        self._missing = self._earlier.copy()
        self._reports: dict[str, tuple[PushReport, ClockTime]] = {}
        self._keys: dict[str, str] = {}

    @property
    def real(self) -> Collection[str]:
        """Names of the vehicles with a real autopilot."""
        return self._addresses

    def add_completed(self, record: PushRecord, needed: Mapping[str, Sequence[str]]) -> None:
        """Record the missing reboots of the vehicles that were complete before the interrupted push was resumed.

        record: record of the resumed push, before it is saved again.
        needed: vehicle -> parameters that were written and take effect only after a reboot.
        """
        from arena.missing_reboots import ClockTime

        saved_at = ClockTime(unix_s=record.path.stat().st_mtime)
        for name, parameters in needed.items():
            vehicle = record.vehicles[name]
            key = self._earlier.key_of(vehicle.uid, vehicle.at)
            earlier = self._earlier.autopilots.get(key)
            if new := [n for n in parameters if earlier is None or n not in earlier.parameters]:
                self._earlier.add(key, name, new, saved_at, address=vehicle.at)

    def before_write(self, vehicle: str, report: PushReport) -> None:
        """Save the missing reboot of a vehicle before the first of its values is sent, because this process may be killed."""
        from arena.missing_reboots import ClockTime

        if vehicle in self._addresses:
            self._reports[vehicle] = (report, ClockTime.now())
            self._update()
            self._save()

    def after_push(
        self, reports: Mapping[str, PushReport], *, dry_run: bool = False
    ) -> dict[str, PushReport]:
        """Update and save the missing reboots. Print those of earlier pushes, and add them to the reports.

        The missing reboot of a vehicle that has booted since the values were written is removed.

        dry_run: the file is not changed.
        """
        from arena.missing_reboots import ClockTime

        now = ClockTime.now()
        self._reports = {
            name: (reports[name], now)
            for name in self._addresses
            if reports[name].ending not in ("no connection", "wrong vehicle") or name in self._reports
        }
        found = dict(reports)
        earlier = self._update()
        for name, (report, _) in self._reports.items():
            key = self._keys[name]
            if name in earlier:
                print(_earlier_text(name, key, earlier[name], report, self._missing.path))
            missing = self._missing.autopilots.get(key)
            found[name] = replace(report, needs_reboot=missing.parameters if missing is not None else ())
        if not dry_run:
            self._save()
        return found

    def on_rebooted(self, vehicle: str) -> None:
        """Remove the missing reboot of a vehicle that has rebooted."""
        self._missing.remove(self._keys[vehicle])
        self._save()

    def _update(self) -> dict[str, MissingReboot]:
        """Compute the missing reboots from those of earlier pushes and the reports of this push.

        Return {vehicle: missing reboot} of the earlier pushes whose reboot is still missing.
        """
        self._missing = missing = self._earlier.copy()
        still: dict[str, MissingReboot] = {}
        for name, (report, now) in self._reports.items():
            address = self._addresses[name]
            key = self._keys[name] = missing.key_of(report.uid, address)
            effective = missing.remove_if_booted(key, report.uptime_s, now)
            if key in missing.autopilots:
                still[name] = missing.autopilots[key]
            needed = [
                n for n in report.needs_reboot if n not in effective or report.results[n].outcome != "same"
            ]
            if needed:
                missing.add(key, name, needed, now, address=address, uptime_s=report.uptime_s)
        return still

    def _save(self) -> None:
        with writable(self._missing.path):
            self._missing.save()


def _earlier_text(name: str, key: str, earlier: MissingReboot, report: PushReport, file: Path) -> str:
    """Return the line about the missing reboot of an earlier push. key: key of its entry in the file."""
    when = datetime.fromtimestamp(earlier.written_at).strftime("%Y-%m-%d %H:%M")
    written = f"{name} still needs a reboot: a push has written {', '.join(earlier.parameters)} on {when}"
    if report.uptime_s is not None:
        return f"{written}, and the autopilot has not booted since"
    return (
        f"{written}, and the autopilot does not report when it booted. Use --reboot. "
        f'If it has rebooted since, you can also remove the entry "{key}" from {file}'
    )


def reboot_vehicles(
    targets: Mapping[str, ParamTarget],
    reports: Mapping[str, PushReport],
    reboots: RebootsOfPush,
    *,
    without_asking: bool,
) -> bool:
    """Reboot the autopilots whose new values need a reboot; on a terminal, ask the user first.

    It waits until PX4 has saved the values. After the reboot it reads the values of real autopilots again.

    reboots: missing reboots of these vehicles, from which a vehicle that has rebooted is removed.
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
    rebooting = {name: wanted[name] for name in reboots.real if refusals.get(name) == ""}
    kept = _have_kept_values(rebooting, reports, requested_at, reboots)
    return kept and not any(refusals.values())


def _have_kept_values(
    targets: Mapping[str, ParamTarget],
    reports: Mapping[str, PushReport],
    requested_at: float,
    reboots: RebootsOfPush,
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
        report_boot_time=[name for name in targets if reports[name].uptime_s is not None],
    )
    problems = {name: list(_problems(name, held[name], report)) for name, report in found.items()}
    for name, lines in problems.items():
        if found[name].ending == "done":
            reboots.on_rebooted(name)
        rebooted = (
            "has rebooted"
            if found[name].uptime_s is not None
            else "has answered after the reboot command, does not report its boot time"
        )
        print("\n".join(lines) or f"{name}: {rebooted}, and has kept all {len(held[name])} values")
    return not any(problems.values())


def _held(report: PushReport) -> dict[str, ParamResult]:
    """Return the parameters that had their wanted values at the end of the push."""
    return {name: result for name, result in report.results.items() if result.outcome in ("same", "written")}


def _not_found_text(after: PullReport) -> str:
    """Return why the values of a vehicle are unknown after the command to reboot, and what to do."""
    if after.ending == "interrupted":
        return (
            "interrupted (Ctrl-C) before the vehicle was found again: the values after the reboot are unknown. "
            "Run the same push again"
        )
    if after.ending == "not rebooted":
        return (
            f"still reports its earlier boot {RETURN_LIMIT_S:g} s after the reboot command. "
            "Switch the vehicle off and on, then run the same push again"
        )
    return (
        f"not found again within {RETURN_LIMIT_S:g} s after the reboot, so its values were not read again "
        f"({ending_text(after.ending, after.why)}). Look at the vehicle and its connection, then run the same push again"
    )


def _problems(vehicle: str, held: Mapping[str, ParamResult], after: PullReport) -> Iterator[str]:
    """Yield one line per value that a rebooted vehicle has lost, or one line if it was not found again.

    held: parameter -> its result at the end of the push.
    after: what was read after the reboot.
    """
    from arena.wire.mavlink_params import alike

    if after.ending != "done":
        yield f"{vehicle}: {_not_found_text(after)}"
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
