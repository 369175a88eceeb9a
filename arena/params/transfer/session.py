"""Parameter transfers with many vehicles at the same time, in one thread.

The thread polls all sockets and serial devices.

    pull(targets, names)        read parameters
    push(targets, wanted)       write parameters that differ
    reboot(targets)             reboot autopilots, so that new values take effect
    read_after_reboot(targets)  find rebooted autopilots again and read parameters

If a vehicle cannot be reached, only its own transfer ends. Ctrl-C ends all transfers; the results so far are returned.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

from arena.params.transfer.after_reboot import AfterRebootReader
from arena.params.transfer.push_record import PushRecord
from arena.params.transfer.reader import ParamReader
from arena.params.transfer.transfer import Ending, Outcome, ParamResult, Rebooter
from arena.params.transfer.transfer_loop import Connection, OnProgress, Traffic, run
from arena.params.transfer.transports import ParamTarget
from arena.params.transfer.uid_check import UidCheck
from arena.params.transfer.writer import ParamWriter
from arena.wire.mavlink_ids import PARAMETER_TOOL
from arena.wire.mavlink_params import Value

_SAVE_PERIOD_S = 0.5  # between two saves of the record, if no old value could be lost
_REOPEN_PERIOD_S = 0.5  # between two attempts to find a rebooted vehicle


@dataclass(frozen=True, kw_only=True)
class PushReport:
    """Result of a push (writing parameters) to one vehicle.

    ending: "done", or why the transfer ended early.
    results: parameter -> outcome.
    needs_reboot: parameters that take effect only after a reboot and were written by this push, or before by the push that
        this push resumes. A value that may be written (sent, but not acknowledged) counts as written.
    why: why the connection could not be opened, or why the vehicle is the wrong one; "" otherwise.
    uid: hardware uid of the vehicle; "" if it sends none.
    uptime_s: time since the vehicle's boot when this report was made [s]; None if the vehicle does not report it.
    firmware: version of the vehicle's firmware, such as "1.16.0"; "" if it does not report it.
    """

    ending: Ending
    results: Mapping[str, ParamResult] = field(default_factory=dict)
    needs_reboot: tuple[str, ...] = ()
    why: str = ""
    traffic: Traffic = field(default_factory=Traffic)
    uid: str = ""
    uptime_s: float | None = None
    firmware: str = ""

    @property
    def holds(self) -> bool:
        """True if the push has ended and the vehicle has every wanted value."""
        return self.ending == "done" and all(r.outcome in ("same", "written") for r in self.results.values())

    def with_outcome(self, *outcomes: Outcome) -> list[str]:
        """Return the names of the parameters whose outcome is one of `outcomes`."""
        return [name for name, result in self.results.items() if result.outcome in outcomes]


@dataclass(frozen=True, kw_only=True)
class PullReport:
    """Result of a pull (reading parameters) from one vehicle.

    ending: "done", or why the transfer ended early.
    why: why the connection could not be opened; "" if it was opened.
    values: parameter name -> value read.
    missing: parameter name, or index in the list -> "unknown" or "unanswered".
    uptime_s: time since the vehicle's boot when this report was made [s]; None if the vehicle has not reported it.
    """

    ending: Ending
    values: Mapping[str, Value] = field(default_factory=dict)
    missing: Mapping[str | int, Outcome] = field(default_factory=dict)
    why: str = ""
    traffic: Traffic = field(default_factory=Traffic)
    uptime_s: float | None = None

    @property
    def complete(self) -> bool:
        """True if every requested parameter was read."""
        return self.ending == "done" and not self.missing


OnRebootNeeded = Callable[[str, PushReport], None]
"""Callback that gets a vehicle name, and the present report of the push to this vehicle, which goes on."""


def push(
    targets: Mapping[str, ParamTarget],
    wanted: Mapping[str, Mapping[str, float]],
    *,
    dry_run: bool = False,
    record: PushRecord | None = None,
    reboot_names: frozenset[str] = frozenset(),
    on_reboot_needed: OnRebootNeeded | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, PushReport]:
    """Write parameters to vehicles: read the present values, write those that differ, and read these back.

    wanted: vehicle -> {parameter: value}.
    dry_run: only read and compare.
    record: record of these vehicles, which is saved during the push. Delete it after the push if `record.wanted` is empty. To
        resume an interrupted push, pass its record, and `record.wanted` as `wanted`, or only some of its vehicles. Nothing is
        written to a vehicle with another PX4 version than its `px4_version` in the record.
    reboot_names: parameters that take effect only after a reboot.
    on_reboot_needed: callback that is called before values of such parameters are sent to a vehicle for the first time.
    Raises OSError if the record cannot be saved. No value is sent before its old value is saved.
    """

    def make(name: str, now: float) -> ParamWriter:
        return ParamWriter(
            system=targets[name].system,
            component=_component(targets[name]),
            now=now,
            wanted=wanted[name],
            dry_run=dry_run,
            px4_version=(record.vehicles[name].px4_version or "") if record is not None else "",
            uid=UidCheck(_expected_uid(name, targets[name], record)),
        )

    earlier = {
        name: frozenset(record.vehicles[name].before) if record is not None else frozenset()
        for name in wanted
    }
    keeper = None if record is None or dry_run else _RecordKeeper(record)
    announced = dict.fromkeys(wanted, frozenset[str]())

    def before_send(connections: Mapping[str, Connection[ParamWriter]]) -> None:
        if keeper is not None:
            keeper.update(connections)
        if on_reboot_needed is None or dry_run:
            return
        for name, connection in connections.items():
            transfer = connection.transfer
            sent = reboot_names & (transfer.unknown.keys() | transfer.written.keys())
            if not sent <= announced[name]:
                announced[name] |= sent
                on_reboot_needed(name, _push_report(connection, reboot_names, earlier[name]))

    connections = run({name: targets[name] for name in wanted}, make, on_progress, before_send)
    reports = {
        name: _push_report(connection, reboot_names, earlier[name])
        for name, connection in connections.items()
    }
    if keeper is not None:
        keeper.update(connections, always=True)
    return reports


def pull(
    targets: Mapping[str, ParamTarget],
    *,
    names: Sequence[str] | None = None,
    on_progress: OnProgress | None = None,
) -> dict[str, PullReport]:
    """Read parameters from vehicles. Return {vehicle: result}.

    names: names of the parameters; None for all parameters.
    """

    def make(name: str, now: float) -> ParamReader:
        uid = UidCheck(targets[name].uid) if targets[name].uid else None
        return ParamReader(
            system=targets[name].system, component=_component(targets[name]), now=now, names=names, uid=uid
        )

    return {
        name: _pull_report(connection) for name, connection in run(targets, make, on_progress, None).items()
    }


def reboot(targets: Mapping[str, ParamTarget]) -> dict[str, str]:
    """Reboot the autopilots of vehicles. Return {vehicle: reason of the failure, or "" after success}."""

    def make(name: str, now: float) -> Rebooter:
        uid = UidCheck(targets[name].uid)
        return Rebooter(system=targets[name].system, component=_component(targets[name]), now=now, uid=uid)

    return {
        name: connection.why
        or connection.transfer.refusal
        or ("" if connection.transfer.ending == "done" else connection.transfer.ending)
        for name, connection in run(targets, make, None, None).items()
    }


def read_after_reboot(
    targets: Mapping[str, ParamTarget],
    names: Mapping[str, Sequence[str]],
    *,
    requested_at: float,
    limit_s: float,
    report_boot_time: Collection[str] = (),
) -> dict[str, PullReport]:
    """Find rebooted vehicles again and read parameters from them. Return {vehicle: result}.

    The socket or device of a vehicle is opened again and again until the vehicle is found: a USB device disappears when the
    autopilot reboots.

    names: vehicle -> names of the parameters.
    requested_at: monotonic time of the command to reboot [s].
    limit_s: time after which a vehicle that was not found is given up [s].
    report_boot_time: names of the vehicles that have reported their boot time before the reboot, and so must report it again.
    """

    def make(name: str, now: float) -> ParamReader:
        return AfterRebootReader(
            system=targets[name].system,
            component=_component(targets[name]),
            now=now,
            names=names[name],
            requested_at=requested_at,
            reports_boot_time=name in report_boot_time,
            uid=UidCheck(targets[name].uid),
        )

    reports: dict[str, PullReport] = {}
    missing, deadline = dict(targets), time.monotonic() + limit_s
    while missing:
        found = {
            name: _pull_report(connection) for name, connection in run(missing, make, None, None).items()
        }
        reports |= found
        over = time.monotonic() >= deadline or any(r.ending == "interrupted" for r in found.values())
        missing = {} if over else {n: t for n, t in missing.items() if found[n].ending != "done"}
        if missing:
            time.sleep(_REOPEN_PERIOD_S)
    return reports


def _component(target: ParamTarget) -> int:
    return PARAMETER_TOOL.component_at(signs=bool(target.key_file))


def _push_report(
    connection: Connection[ParamWriter], reboot_names: frozenset[str], earlier: frozenset[str]
) -> PushReport:
    """Return the result of a push to one vehicle.

    earlier: parameters that differed when the resumed push began. If such a value is right now, that push has written it,
        perhaps without an acknowledgement.
    """
    results = connection.transfer.result
    needs = tuple(
        name
        for name, result in results.items()
        if name in reboot_names
        and (result.may_have_changed or (result.outcome == "same" and name in earlier))
    )
    return PushReport(
        ending=connection.transfer.ending,
        results=results,
        needs_reboot=needs,
        why=connection.why,
        traffic=connection.traffic,
        uid=connection.uid,
        uptime_s=connection.uptime_s,
        firmware=connection.transfer.firmware,
    )


def _expected_uid(name: str, target: ParamTarget, record: PushRecord | None) -> str:
    """Return the hardware uid that the vehicle must report, so that a push never writes to a wrong vehicle.

    If a push is resumed and its record contains a uid, this uid is returned; otherwise the uid of `target`.
    """
    resumed = record.vehicles[name].uid if record is not None else ""
    return resumed or target.uid


def _pull_report(connection: Connection[ParamReader]) -> PullReport:
    transfer = connection.transfer
    return PullReport(
        ending=transfer.ending,
        values=transfer.values,
        missing=transfer.missing,
        why=connection.why,
        traffic=connection.traffic,
        uptime_s=connection.uptime_s,
    )


class _RecordKeeper:
    """Writer that saves the record of a push to its file while the push runs.

    It saves immediately after old values were read, because they may be needed to undo the push, and before the first value is
    sent, because the push must be resumed from then on. Otherwise it saves at most twice per second.
    """

    def __init__(self, record: PushRecord) -> None:
        self.record = record
        self._next = 0.0
        record.save()

    def update(self, connections: Mapping[str, Connection[ParamWriter]], *, always: bool = False) -> None:
        now, urgent, changed = time.monotonic(), always, False
        for name, connection in connections.items():
            old = self.record.vehicles[name]
            changed |= self.record.update(
                name,
                connection.transfer.before,
                connection.transfer.written,
                connection.transfer.ending,
                connection.uid,
                unknown=connection.transfer.unknown,
                known=connection.transfer.known,
            )
            new = self.record.vehicles[name]
            urgent |= len(new.before) > len(old.before)
            urgent |= new.unfinished and not old.unfinished
        if urgent or (changed and now >= self._next):
            self._next = now + _SAVE_PERIOD_S
            self.record.save()
