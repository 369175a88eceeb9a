"""The panic path's sockets: every vehicle at once, on its panic link and through its router, until all are confirmed; a real one
also straight on its wire, when nothing is heard of it.
"""

from __future__ import annotations

import contextlib
import os
import resource
import select
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from arena.emergency.direct_link import DirectLink
from arena.emergency.landing_sequence import Action, Landing
from arena.emergency.run_record import told_down
from arena.emergency.targets import Target
from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK

_TURN_S = 0.05
_DATAGRAM_BYTES = 1 << 16
_AT_A_TIME = 64  # datagrams of one socket in one turn
# A simulated vehicle that its run has written down as crashed, or as without its PX4, is tried for so long: it may fly on after a
# touch, and lands in that time; silent, it will not speak.
_TRY_DOWN_S, _TRY_SILENT_S, _LOOK_S = 15.0, 3.0, 1.0
_REBIND_S = 0.5

Say = Callable[[str], None]


def own_component() -> int:
    """190 to 249, so that two at a time are told apart by the acknowledgements' target."""
    return 190 + os.getpid() % 60


class Link:
    """One vehicle, its state machine and the ways to it."""

    def __init__(self, target: Target, landing: Landing, say: Say, now: float) -> None:
        self.target, self.landing = target, landing
        self.down = ""
        self.router = _open()
        self.panic = _bound(target.partner)
        self._began, self._next_bind = now, now + _REBIND_S
        self._straight = (
            DirectLink(
                target.wire,
                name=target.name,
                system=target.id,
                door=target.autopilot,
                say=say,
            )
            if target.wire is not None
            else None
        )

    def send(self, now: float) -> None:
        frames = self.landing.due(now)
        for frame in frames:
            for sock, dest in (
                (self.panic or self.router, self.target.autopilot),
                (self.router, self.target.tools),
            ):
                with contextlib.suppress(OSError):  # a network that is away now may be back at the next try
                    sock.sendto(frame, dest)
        if self._straight is not None:
            heard = self.landing.known.heard_at
            if not self.landing.confirmed:
                self._straight.step(now - (self._began if heard is None else heard), now)
            for frame in frames:
                self._straight.send(frame)
        if self.panic is None and now >= self._next_bind:
            self._next_bind = now + _REBIND_S
            self.panic = _bound(self.target.partner)

    def ears(self) -> dict[int, Callable[[], None]]:
        """File descriptor -> what reads it."""
        found: dict[int, Callable[[], None]] = {
            sock.fileno(): partial(self._read, sock) for sock in (self.router, self.panic) if sock is not None
        }
        if self._straight is not None:
            found |= {fd: partial(self._read_straight, fd) for fd in self._straight.files()}
        return found

    def _read(self, sock: socket.socket) -> None:
        for _ in range(_AT_A_TIME):
            try:
                data, sender = sock.recvfrom(_DATAGRAM_BYTES)
            except OSError:
                return
            if sender in (self.target.autopilot, self.target.tools):
                self.landing.hear(data, time.monotonic())

    def _read_straight(self, fd: int) -> None:
        assert self._straight is not None
        for data in self._straight.read(fd):
            self.landing.hear(data, time.monotonic())

    def over(self, began: float, now: float) -> bool:
        """Settled; or the run tells why it will not be, and it was tried long enough."""
        silent = self.landing.known.heard_at is None
        if self.landing.confirmed:
            return self.landing.settled(now)
        return bool(self.down) and now - began > (_TRY_SILENT_S if silent else _TRY_DOWN_S)

    def line(self, now: float) -> str:
        told = f"; its run says: {self.down}" if self.down and not self.landing.confirmed else ""
        return self.landing.line(now) + told

    def close(self) -> None:
        for held in (self.panic, self.router, self._straight):
            if held is not None:
                held.close()


def bring_down(targets: Sequence[Target], *, action: Action, timeout_s: float, say: Say = print) -> int:
    """Command all vehicles until each is confirmed or the time is over; says a line for each. Returns the exit code."""
    _allow_files()
    began = time.monotonic()
    component = own_component()
    links: list[Link] = []
    alone = _Alone(say)
    for t in targets:
        with alone(t.name):
            links.append(
                Link(
                    t,
                    Landing(name=t.name, system=t.id, component=component, action=action, now=began),
                    say,
                    began,
                )
            )
    code = EXIT_OK
    try:
        _work(links, began, began + timeout_s, say, alone)
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    for link in links:
        say(link.line(time.monotonic()))
        link.close()
    for name in (names := [t.name for t in targets if t.name not in {link.target.name for link in links}]):
        say(f"{name}: NOT CONFIRMED: it could not be spoken to")
    return code or (EXIT_OK if not names and all(link.landing.confirmed for link in links) else EXIT_FAILED)


class _Alone:
    """Whatever goes wrong with one vehicle is told once, and keeps no other in the air."""

    def __init__(self, say: Say) -> None:
        self._say, self._told = say, set[str]()

    @contextlib.contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            words = f"{name}: {type(error).__name__}: {error}; trying on"
            if words not in self._told:
                self._told.add(words)
                self._say(words)


def _work(links: list[Link], began: float, end: float, say: Say, alone: _Alone) -> None:
    refusals: dict[str, str] = {}
    next_look = began + _LOOK_S
    while (now := time.monotonic()) < end:
        if now >= next_look:
            next_look = now + _LOOK_S
            with alone("the record of the run"):
                _look_into_records(links)
        for link in links:
            with alone(link.target.name):
                link.send(now)
                _say_refusal(link.landing, refusals, say)
        if all(link.over(began, now) for link in links):
            return
        _listen(links, alone)


def _listen(links: list[Link], alone: _Alone) -> None:
    """For one turn, or until somebody speaks."""
    poll = select.poll()
    readers = {fd: (link.target.name, read) for link in links for fd, read in link.ears().items()}
    for fd in readers:
        poll.register(fd, select.POLLIN)
    for fd, _ in poll.poll(_TURN_S * 1e3):
        name, read = readers[fd]
        with alone(name):
            read()


def _look_into_records(links: list[Link]) -> None:
    waiting = [link for link in links if not link.landing.confirmed and link.target.run is not None]
    for run in {link.target.run for link in waiting if link.target.run is not None}:
        down = told_down(run, [link.target.name for link in waiting if link.target.run == run])
        for link in waiting:
            if link.target.run == run:
                link.down = down.get(link.target.name, "")


def _say_refusal(landing: Landing, said: dict[str, str], say: Say) -> None:
    if landing.refusal and said.get(landing.name) != landing.refusal:
        said[landing.name] = landing.refusal
        say(f"{landing.name}: {landing.refusal}; trying on")


def _bound(address: tuple[str, int]) -> socket.socket | None:
    """The panic link's own end, or None while another land-all holds it: PX4 obeys every sender, but answers that one.

    Until it has ended we send from elsewhere, and hear through the router.
    """
    sock = _open()
    try:
        sock.bind(address)
    except OSError:
        sock.close()
        return None
    return sock


def _open() -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    return sock


def _allow_files() -> None:
    """Three sockets a vehicle: two hundred are more than some shells allow."""
    with contextlib.suppress(OSError, ValueError):
        _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, most))
