"""Link process of one flight controller: its sockets, its serial device and its loop.

It connects the controller by UDP to the MAVLink router (router link), the pose forwarder (vision link) and land-all (panic
link).

Run as `python -m arena.fcu_link slice.json`.
"""

from __future__ import annotations

import contextlib
import select
import sys
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from arena.background_writer import BackgroundWriter
from arena.clock_reading import boot_id
from arena.fcu_link.axes_record import RecordFile
from arena.fcu_link.core import SIMULATOR, FcuLink, Out
from arena.fcu_link.missing_reboot_check import MissingRebootCheck
from arena.fcu_link.room_capture import RoomCapture
from arena.fcu_link.settings import Settings
from arena.fcu_link.signing import LinkSigning
from arena.fcu_link.simulator_client import SimulatorClient, controller_greeting
from arena.fcu_link.transports import FcuTransport, open_transport
from arena.fcu_link.wire_record import WireRecord
from arena.process_context import (
    SUPERVISOR_LOST,
    ProcessContext,
    ShutdownPolicy,
    run_and_close,
    run_process,
)
from arena.transport import AgedSocket, StampAges, listen_udp
from arena.wire.mavlink_minimal import NO_UID
from arena.wire.qgc_params import format_params

_TICK_S = 0.05
_SECOND_S = 1.0
_MAX_FILES, _FLUSH_S = 100, 1.0
_HEADER = (
    "Parameters required for {vehicle}. In QGroundControl: Vehicle Setup > Parameters > Tools > Load from file, then reboot.",
    "Load it twice: some parameters appear only after others are set.",
    "System  Component  Name  Value  Type",
)


class FcuLinkShell:
    """Sockets, serial device and loop of the link process of one flight controller.

    The loop reads a limited amount from each connection in turn, so that a flood on one connection does not delay the
    others.
    """

    def __init__(self, process: ProcessContext, settings: Settings) -> None:
        now = time.monotonic()
        self._process, self._s = process, settings
        self._record = WireRecord(settings.wire_file)
        self._axes_file = RecordFile(settings.axes_file)
        self._axes_record = self._axes_file.read()
        self._axes_status: dict[str, object] = {}
        self._core = FcuLink(settings, now, *self._record.read(), self._axes_record)
        self._room = RoomCapture(settings.capture)
        self._signing = LinkSigning(settings, self._core.counts)
        self._ages = StampAges(time.time(), now)
        self._sockets = {
            name: AgedSocket(listen_udp(ends.local, f"the {name} link"), self._ages, now)
            for name, ends in settings.links.items()
        }
        self._remotes = {name: ends.remote for name, ends in settings.links.items()}
        self._by_fd = {s.fileno(): name for name, s in self._sockets.items()}
        self._transport: FcuTransport = open_transport(settings.connection, self._core, now)
        core, simulator = self._core, settings.simulator
        self._simulator = (
            SimulatorClient(simulator, core.counts, controller_greeting(settings.id))
            if simulator is not None
            else None
        )
        self._shutdown = ShutdownPolicy(limit_s=60.0 if settings.simulated else None)
        self._next_tick = self._next_second = now
        self._flow: Counter[str] = Counter()
        self._ready = self._over = self._types_written = False
        self._permit: dict[str, object] = {}
        self._computer = boot_id()
        self._set_time(now)
        self._files, self._file_errors = BackgroundWriter("files", _MAX_FILES), SimpleQueue[str]()
        self._reboots = MissingRebootCheck(settings.missing_reboots)
        self._check_reboot()
        self._write_params()

    def run(self) -> None:
        """Run the link until a stop signal arrives. If a real vehicle is armed, wait until it is disarmed.

        If the supervisor dies, continue until the vehicle is disarmed.
        """
        self._take_requests(
            time.monotonic()
        )  # of the time before a restart, before the first command is passed on
        while not (self._over or (self._process.stopping and self._process.may_end(self._armed_real()))):
            self._wait()
            now = time.monotonic()
            for source, data, found in self._transport.read(now):
                signed = self._signing.accepted(source, data, found, now)
                self._send(self._core.from_vehicle(data, signed, now, source))
            if self._simulator is not None:
                for data, found in self._simulator.read():
                    self._core.from_simulator(data, found, now)
            self._core.axes.on_frames(self._room.poll(now), now)
            if now >= self._next_tick:
                self._tick(now)
            self._flush(now)
        self._report_stats(time.monotonic())

    def _armed_real(self) -> list[str]:
        """Return the name of the vehicle in a list if it is real and armed, so that this process must not end; else [].

        `ProcessContext.may_end` takes this list.
        """
        armed = not self._s.simulated and self._core.armed(time.monotonic())
        return [self._s.vehicle] if armed else []

    def close(self) -> None:
        self._files.flush(_FLUSH_S)
        self._transport.close()
        self._room.close()
        if self._simulator is not None:
            self._simulator.close()
        for s in self._sockets.values():
            s.close()

    def _wait(self) -> None:
        """Wait until a connection can be read or written, or until the next tick is due.

        Then read the router, vision and panic links.

        `run` reads the other connections: flight controller, simulator and motion capture.
        """
        now = time.monotonic()
        poll = select.poll()
        for link in self._sockets.values():
            poll.register(link, select.POLLIN)
        if (wire := self._transport.fileno()) is not None:
            poll.register(wire, select.POLLIN | (select.POLLOUT if self._transport.wants_write() else 0))
        if (room := self._room.fileno()) is not None:
            poll.register(room, select.POLLIN)
        if (
            self._simulator is not None
            and self._simulator.connected
            and (world := self._simulator.fileno()) is not None
        ):
            poll.register(world, select.POLLIN)
        until = min(self._next_tick, now + 0.002) if len(self._core.queue) else self._next_tick
        readable = {fd for fd, _ in poll.poll(max(0.0, 1e3 * (until - now)))}
        for fd, name in self._by_fd.items():
            if fd in readable:
                self._read_link(name)
            else:
                # `now` is before the poll, in case the process was paused after it
                self._sockets[name].on_empty(now)

    def _read_link(self, name: str) -> None:
        link, remote = self._sockets[name], self._remotes[name]
        for data, sender, age_s in link.receive():
            if sender == remote or (
                name == "panic" and sender[0] == remote[0]
            ):  # a second land-all, which PX4 would obey too
                self._send(self._core.from_link(name, data, time.monotonic(), age_s))
            else:
                self._core.counts[f"from {name}: unknown sender"] += 1

    def _send(self, out: Out) -> None:
        for end, data in out:
            if end == SIMULATOR:
                if self._simulator is not None:
                    self._simulator.write(data)
                continue
            with contextlib.suppress(OSError):  # no receiver yet: MAVLink repeats
                self._sockets[end].sendto(data, self._remotes[end])

    def _flush(self, now: float) -> None:
        for source, request in (*self._core.own.uid_requests(now), *self._signing.timestamp_heartbeats()):
            if (frame := self._signing.signed(request)) is not None:
                self._transport.request(source, frame)
        if not self._transport.write(lambda: self._signing.next_frame(self._core.next_out, now), now):
            self._core.queue.clear()

    def _tick(self, now: float) -> None:
        self._next_tick = max(self._next_tick + _TICK_S, now)
        self._ages.update(time.time(), now)
        self._transport.tick(now)
        self._set_time(now)
        self._core.tick(now)
        self._signing.tick(now)
        self._core.signing_problem = self._signing.problem
        self._process.audit(self._core.gate.audit.take())
        self._take_requests(now)
        if self._simulator is not None:
            self._simulator.tick(self._core.alive(now), now)
        self._update_axes_check()
        self._report_events()
        self._write_last_address()
        if not self._types_written and self._core.params.complete:
            self._write_params()
        if now >= self._next_second or self._core.identity.uid != self._reboot_uid:
            self._check_reboot()
        orphaned = self._process.orphaned
        if orphaned:
            self._core.gate.on_request(SUPERVISOR_LOST, now)
        self._over = self._shutdown.over(orphaned=orphaned, any_armed=self._core.armed(now), now=now)
        if now >= self._next_second:
            self._report_stats(now)
            self._next_second = max(self._next_second + _SECOND_S, now)

    def _check_reboot(self) -> None:
        """Check whether the vehicle must still be rebooted after `arena params push`."""
        core, self._reboot_uid = self._core, self._core.identity.uid
        if not core.checks.armed:  # a slow disk must not delay the messages of a flight
            core.missing_reboot = self._reboots.reasons(self._reboot_uid, core.axes.boot)

    def _take_requests(self, now: float) -> None:
        for request in self._process.requests():
            self._core.on_request(request, now)
            self._process.confirm(request)

    def _set_time(self, now: float) -> None:
        """Store the date, the boot id of this computer and how long it was suspended, for the axes check's record."""
        suspended_s = time.clock_gettime(time.CLOCK_BOOTTIME) - now
        self._core.axes.set_time(
            self._computer, suspended_s, time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
        )

    def _update_axes_check(self) -> None:
        """Advance a running axes check: receive the poses of all bodies in the room, and report the progress.

        At the end of the check, its record is written.
        """
        axes = self._core.axes
        self._room.set_open(axes.running)
        if self._room.error:
            axes.stop(f"the other bodies of the room cannot be received: {self._room.error}")
        if axes.record != self._axes_record:
            self._axes_record = axes.record
            effect = (
                ". Delete this file: it records an earlier axes check, which would count after a restart"
                if axes.record is None
                else f", so the axes check is valid until link.{self._s.vehicle} ends"
            )
            self._save(self._s.axes_file, partial(self._axes_file.write, axes.record), effect)
        if axes.status != self._axes_status:
            self._axes_status = axes.status
            self._process.stats({"axes_check": axes.status})

    def _report_events(self) -> None:
        if not self._ready and self._core.ever_connected and self._core.params.complete:
            self._ready = True
            self._process.ready()
        simulator_events = self._simulator.events if self._simulator is not None else []
        for events in (
            self._transport.events,
            self._signing.events,
            self._reboots.events,
            simulator_events,
        ):
            for text in events:
                self._say(f"{self._s.vehicle}: {text}")
            events.clear()
        for text in self._core.events():
            self._say(text)
        while not self._file_errors.empty():
            self._say(self._file_errors.get())
        permit = self._core.permit
        state: dict[str, object] = {"arm_permit": permit.by, "arm_permit_answer": permit.answer}
        if state != self._permit:
            self._permit = state
            self._process.stats(state)
        facts = self._core.gate.changed_facts("_at_link")
        if facts and not self._s.simulated:  # the router reports simulated vehicles
            self._process.facts(facts)

    def _say(self, text: str) -> None:
        print(text, flush=True)
        self._process.event(text)

    def _report_stats(self, now: float) -> None:
        """Send the message counters of the last second to the supervisor."""
        flow, self._flow = self._core.flow - self._flow, Counter(self._core.flow)
        self._process.stats(
            {
                "from_vehicle_hz": flow["from_vehicle"],
                "to_vehicle_hz": flow["to_vehicle"],
                "poses_hz": flow["poses"],
                "partner": self._transport.peer(),
                "armed": self._core.armed(now),
                "battery": self._core.checks.charge_percent(now),
                "uid": self._core.identity.uid,
                "arm_permit": self._core.permit.by,
                "may_not_arm": self._core.reasons(now),
                "axes_check": self._core.axes.status,
                "dropped": dict(self._core.counts),
            }
        )

    def _write_last_address(self) -> None:
        """Write the vehicle's address and hardware uid to a file for land-all.

        land-all needs this file if the link process ends or hangs.
        """
        uid = self._core.identity.uid
        address = self._transport.last_address() | {"uid": "" if uid == NO_UID else uid}
        if self._record.is_new(address):
            self._save(self._s.wire_file, partial(self._record.write, address))

    def _write_params(self) -> None:
        """Write the file of required parameters, which the user loads with QGroundControl.

        The file is written at the start. It is written again when the types of the vehicle's parameters are
        known.
        """
        if not self._s.params_file or not self._s.params:
            return
        types = self._core.params.types
        self._types_written = bool(types) and self._core.params.complete
        header = [line.format(vehicle=self._s.vehicle) for line in _HEADER]
        text = format_params(self._s.params, self._s.id, header=header, types=types)
        self._save(self._s.params_file, partial(_write_text, Path(self._s.params_file), text))

    def _save(self, path: str, write: Callable[[], None], effect: str = "") -> None:
        """Write a file in a thread, so that a slow disk does not stop the link.

        An error is reported. effect: what the error leads to, as the end of its message.
        """

        def save() -> None:
            try:
                write()
            except OSError as error:
                self._file_errors.put(f"{self._s.vehicle}: cannot write {path}: {error.strerror}{effect}")

        self._files.submit(save)


def _write_text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def main(argv: list[str] | None = None) -> int:
    return run_process("link", _make, argv)


def _make(process: ProcessContext) -> Callable[[], None]:
    return run_and_close(FcuLinkShell(process, Settings.from_slice(process.settings)))


if __name__ == "__main__":
    sys.exit(main())
