"""Sockets and main loop of `land-all` and `kill-all`.

Every vehicle is commanded until it is confirmed as landed (or stopped).

The loop also ends when the timeout has passed.
Each vehicle is commanded on its panic link and through its router. A real vehicle without telemetry is also
commanded directly.
"""

from __future__ import annotations

import contextlib
import resource
import select
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from arena.emergency.direct_link import DirectLink
from arena.emergency.first_commands import component_for
from arena.emergency.identity_check import IdentityCheck
from arena.emergency.landing_sequence import TELEMETRY_STALE_S, Action, LandingSequence
from arena.emergency.link_process import has_ended
from arena.emergency.run_record import has_given_up, recorded_down, recorded_process
from arena.emergency.targets import Target
from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK
from arena.transport import open_udp, receive_datagrams

_TURN_S = 0.05
# Time for which a simulated vehicle is tried whose run records a crash, or the end of its PX4 or world. It may fly on after a collision.
_TRY_DOWN_S, _TRY_SILENT_S = 15.0, 3.0
_READ_RECORD_S = 1.0
_FIRST_HEARTBEAT_S = 1.0
_REBIND_S = 0.5

Say = Callable[[str], None]


class TargetConnections:
    """All connections of `land-all` to one vehicle, and the landing sequence of the vehicle.

    down: reason why the run records the vehicle as crashed or ended; "" if it does not
    world_ended: the vehicle is only simulated, and the run records the end of its world
    """

    def __init__(self, target: Target, landing: LandingSequence, say: Say, now: float) -> None:
        self.target, self.landing = target, landing
        self.down, self.world_ended = "", False
        self.router = open_udp()
        self.panic = _open_panic_link(target)
        self._began, self._next_bind = now, now + _REBIND_S
        self._direct: DirectLink | None = None
        self._relayed: IdentityCheck | None = None
        self._link = f"link.{target.name}"
        self._say_once = _OnceEach(lambda text: say(f"{target.name}: {text}"))
        if target.direct is not None:
            system, component, uid = target.id, landing.component, target.direct.uid
            self._direct = DirectLink(
                target.direct,
                name=target.name,
                system=system,
                component=component,
                link_address=target.autopilot,
                say=say,
            )
            if uid:
                self._relayed = IdentityCheck(
                    system=system, component=component, uid=uid, recorded=self._link, say=self._say_once
                )

    def send(self, now: float) -> None:
        """Send the frames that are due now to the vehicle, on every connection to it."""
        self._read_waiting()
        frames = self.landing.due(now)
        self._send_relayed(frames, now)
        if self._direct is not None:
            received_at = self.landing.reported.received_at
            silent_s = now - (self._began if received_at is None else received_at)
            self._direct.step(silent_s, now, needed=not self.landing.confirmed)
            self._direct.send(frames if self._may_bypass(now) else [], now)
        if self.panic is None and now >= self._next_bind:
            self._next_bind = now + _REBIND_S
            self.panic = _open_panic_link(self.target)

    def _read_waiting(self) -> None:
        """Read what has arrived. After a pause of this computer, a heartbeat may report that a pilot has control."""
        poll, readers = select.poll(), self.readers()
        for fd in readers:
            poll.register(fd, select.POLLIN)
        for fd, _ in poll.poll(0):
            # An error must not stop the commands to the vehicle. `_receive` reads again, and reports it.
            with contextlib.suppress(Exception):
                readers[fd]()

    def _may_bypass(self, now: float) -> bool:
        """Return whether `land-all` may command the vehicle directly, without its link process.

        Return False in the first second until the first heartbeat has arrived, because the heartbeat may report that a
        pilot has control.
        """
        if self.landing.reported.armed is None and now - self._began < _FIRST_HEARTBEAT_S:
            return False
        if not self.landing.may_bypass and self._direct is not None and self._direct.files():
            self._say_once("a pilot may have control: not commanded directly")
        return self.landing.may_bypass

    def _send_relayed(self, frames: list[bytes], now: float) -> None:
        """Send frames to the vehicle on its panic link and through its MAVLink router.

        A real vehicle is also requested to send its hardware uid. If the uid shows that the link process is connected to
        another vehicle, only these requests are sent.
        """
        if self._relayed is not None:
            requests = [request for _, request in self._relayed.requests(now)]
            frames = requests if self._relayed.is_other(self._link) else [*frames, *requests]
        for frame in frames:
            with contextlib.suppress(OSError):  # a network that is away may be back at the next turn
                (self.panic or self.router).sendto(frame, self.target.autopilot)
            with contextlib.suppress(OSError):
                self.router.sendto(frame, self.target.tools)

    def readers(self) -> dict[int, Callable[[], None]]:
        """Return the open connections to the vehicle: file descriptor -> function that reads from it."""
        found: dict[int, Callable[[], None]] = {
            sock.fileno(): partial(self._read, sock) for sock in (self.router, self.panic) if sock is not None
        }
        if self._direct is not None:
            found |= {fd: partial(self._read_direct, fd) for fd in self._direct.files()}
        return found

    def is_over(self, began: float, now: float) -> bool:
        """Return whether to stop commanding this vehicle.

        This is the case if the vehicle is confirmed as landed or stopped. It is also the case if the run folder records
        that the vehicle crashed, or that its PX4 or its world has ended, and commands were sent for long enough.
        """
        if self.landing.confirmed:
            return self.landing.settled(now)
        gone = self.gone(now)
        limit_s = _TRY_SILENT_S if gone or self.landing.reported.received_at is None else _TRY_DOWN_S
        return (bool(self.down) or gone) and now - began > limit_s

    def gone(self, now: float) -> bool:
        """Return whether the simulation of this vehicle has ended, so that the vehicle does not fly.

        False for a vehicle that still sends telemetry, and for one whose last reports are those of a flying vehicle.
        """
        reported = self.landing.reported
        if not self.world_ended or self.landing.confirmed:
            return False
        if reported.received_at is None:
            return True
        flew = reported.armed is True or reported.landed is False
        return now - reported.received_at >= TELEMETRY_STALE_S and (self.landing.reported_down or not flew)

    def result_line(self, now: float) -> str:
        if self.gone(now):
            return f"{self.landing.name}: does not fly: its simulation has ended"
        recorded = f"; the run records: {self.down}" if self.down and not self.landing.confirmed else ""
        return self.landing.result_line(now) + recorded

    def close(self) -> None:
        for held in (self.panic, self.router, self._direct):
            if held is not None:
                held.close()

    def _read(self, sock: socket.socket) -> None:
        for data, sender in receive_datagrams(sock):
            known = sender in (self.target.autopilot, self.target.tools)
            now = time.monotonic()
            if known:
                self.landing.on_refusal(data)
            if known and (self._relayed is None or self._relayed.receive(data, self._link, now)):
                self.landing.on_datagram(data, now)

    def _read_direct(self, fd: int) -> None:
        assert self._direct is not None
        now = time.monotonic()
        for data in self._direct.read(fd, now):
            self.landing.on_datagram(data, now)


def bring_down(targets: Sequence[Target], *, action: Action, timeout_s: float, say: Say = print) -> int:
    """Command all vehicles until each is confirmed as landed (or stopped). Return the exit code.

    The commands end when the timeout has passed.

    One line is printed for each vehicle.
    timeout_s: [s]
    say: function that prints a line for the user
    """
    _raise_file_limit()
    began = time.monotonic()
    all_connections: list[TargetConnections] = []
    isolated = _Isolation(say)
    names = [t.name for t in targets]
    for t in targets:
        with isolated(t.name):
            number = component_for(t)
            landing = LandingSequence(
                name=t.name if names.count(t.name) == 1 else t.name_in_run,
                system=t.id,
                component=number,
                action=action,
                now=began,
                radio=t.radio,
            )
            all_connections.append(TargetConnections(t, landing, say, began))
    code = EXIT_OK
    try:
        _work(all_connections, began, began + timeout_s, say, isolated)
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    for connections in all_connections:
        say(connections.result_line(time.monotonic()))
        connections.close()
    opened = {connections.target.name for connections in all_connections}
    failed = [t.name for t in targets if t.name not in opened]
    for name in failed:
        say(f"{name}: NOT CONFIRMED: no connection could be opened, so no command was sent")
    confirmed = not failed and all(c.landing.confirmed or c.gone(time.monotonic()) for c in all_connections)
    return code or (EXIT_OK if confirmed else EXIT_FAILED)


class _OnceEach:
    """Callable that prints a text for the user, unless it has printed the same text before."""

    def __init__(self, say: Say) -> None:
        self._say, self._printed = say, set[str]()

    def __call__(self, text: str) -> None:
        if text not in self._printed:
            self._printed.add(text)
            self._say(text)


class _Isolation:
    """Context manager that prints the errors of one vehicle, so that the landing of the others continues.

    Each error is printed once.
    """

    def __init__(self, say: Say) -> None:
        self._say = _OnceEach(say)

    @contextlib.contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            self._say(f"{name}: {type(error).__name__}: {error}; retrying")


def _work(
    all_connections: list[TargetConnections], began: float, end: float, say: Say, isolated: _Isolation
) -> None:
    said = _OnceEach(say)
    next_record = began + _READ_RECORD_S
    while (now := time.monotonic()) < end:
        if now >= next_record:
            next_record = now + _READ_RECORD_S
            with isolated("the record of the run"):
                _read_records(all_connections)
        for connections in all_connections:
            with isolated(connections.target.name):
                connections.send(now)
                _say_changes(connections.landing, said, say)
        if all(connections.is_over(began, now) for connections in all_connections):
            return
        _receive(all_connections, isolated)


def _receive(all_connections: list[TargetConnections], isolated: _Isolation) -> None:
    """Read all waiting data of all vehicles, in one cycle of the loop."""
    poll = select.poll()
    readers = {
        fd: (connections.target.name, read)
        for connections in all_connections
        for fd, read in connections.readers().items()
    }
    for fd in readers:
        poll.register(fd, select.POLLIN)
    for fd, _ in poll.poll(_TURN_S * 1e3):
        name, read = readers[fd]
        with isolated(name):
            read()


def _read_records(all_connections: list[TargetConnections]) -> None:
    waiting = [c for c in all_connections if not c.landing.confirmed and c.target.run is not None]
    for run in {c.target.run for c in waiting if c.target.run is not None}:
        down = recorded_down(run, [c.target.name for c in waiting if c.target.run == run])
        world_ended = _has_world_ended(run)
        for connections in waiting:
            if connections.target.run == run:
                connections.down = down.get(connections.target.name, "")
                connections.world_ended = connections.target.ends_with_world and world_ended


def _has_world_ended(run: Path) -> bool:
    """Return whether the process `world` of a run has ended and nothing starts it again.

    If the supervisor was killed, no end is recorded. Then neither of the two processes may exist any more.
    """
    if has_given_up("world", run):
        return True
    members = [recorded_process(name, run) for name in ("supervisor", "world")]
    return all(member is not None and has_ended(member) for member in members)


def _say_changes(landing: LandingSequence, say_once: _OnceEach, say: Say) -> None:
    for text in landing.take_events():
        say(f"{landing.name}: {text}")
    if landing.refusal:
        say_once(f"{landing.name}: {landing.refusal}; retrying")


def _open_panic_link(target: Target) -> socket.socket | None:
    """Open the UDP socket for the panic link to a vehicle; None if another `land-all` uses the port.

    The panic link is a separate MAVLink connection of each autopilot, for emergencies only.

    The autopilot obeys every sender on its panic link, but replies only to the address `target.partner`. While another
    program uses this address, commands are sent from another port and telemetry comes through the router.
    """
    try:
        return open_udp(target.partner)
    except OSError:
        return None


def _raise_file_limit() -> None:
    """Raise the limit of open files to the maximum of the system.

    `land-all` needs three sockets per vehicle, which exceeds the limit of some shells.
    """
    with contextlib.suppress(OSError, ValueError):
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
