"""The panic path's sockets: every vehicle at once, on its panic link and through its router, until all are confirmed."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
from collections.abc import Callable, Sequence

from arena.errors import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK
from arena.safety.landing import Action, Landing
from arena.safety.record import told_down
from arena.safety.targets import Target

_TURN_S = 0.05
_DATAGRAM_BYTES = 1 << 16
_AT_A_TIME = 64  # datagrams of one socket in one turn
# A simulated vehicle that its run has written down as crashed, or as without its PX4, is tried for so long: it may fly on after a
# touch, and lands in that time; silent, it will not speak.
_TRY_DOWN_S, _TRY_SILENT_S, _LOOK_S = 15.0, 3.0, 1.0


def own_component() -> int:
    """190 to 249, so that two at a time are told apart by the acknowledgements' target."""
    return 190 + os.getpid() % 60


class Link:
    """One vehicle, its state machine and the two sockets towards it."""

    def __init__(self, target: Target, landing: Landing) -> None:
        self.target, self.landing = target, landing
        self.down = ""
        self.panic = _open(target.partner)
        self.router = _open(None)

    def send(self, now: float) -> None:
        for frame in self.landing.due(now):
            for sock, dest in ((self.panic, self.target.autopilot), (self.router, self.target.tools)):
                with contextlib.suppress(OSError):  # a network that is away now may be back at the next try
                    sock.sendto(frame, dest)

    def read(self, sock: socket.socket) -> None:
        for _ in range(_AT_A_TIME):
            try:
                data, sender = sock.recvfrom(_DATAGRAM_BYTES)
            except OSError:
                return
            if sender in (self.target.autopilot, self.target.tools):
                self.landing.hear(data, time.monotonic())

    def over(self, began: float, now: float) -> bool:
        """Confirmed; or the run tells why it will not be, and it was tried long enough."""
        silent = self.landing.known.heard_at is None
        return self.landing.confirmed or (bool(self.down) and now - began > (_TRY_SILENT_S if silent else _TRY_DOWN_S))

    def line(self, now: float) -> str:
        told = f"; its run says: {self.down}" if self.down and not self.landing.confirmed else ""
        return self.landing.line(now) + told

    def close(self) -> None:
        self.panic.close()
        self.router.close()


def bring_down(
    targets: Sequence[Target], *, action: Action, timeout_s: float, say: Callable[[str], None] = print
) -> int:
    """Command all vehicles until each is confirmed or the time is over; says a line for each. Returns the exit code."""
    began = time.monotonic()
    component = own_component()
    links = [
        Link(t, Landing(name=t.name, system=t.id, component=component, action=action, now=began)) for t in targets
    ]
    code = EXIT_OK
    try:
        _work(links, began, began + timeout_s, say)
    except KeyboardInterrupt:
        code = EXIT_INTERRUPTED
    for link in links:
        say(link.line(time.monotonic()))
        link.close()
    return code or (EXIT_OK if all(link.landing.confirmed for link in links) else EXIT_FAILED)


def _work(links: list[Link], began: float, end: float, say: Callable[[str], None]) -> None:
    poll = select.poll()
    owners: dict[int, tuple[Link, socket.socket]] = {}
    for link in links:
        for sock in (link.panic, link.router):
            owners[sock.fileno()] = link, sock
            poll.register(sock, select.POLLIN)
    refusals: dict[str, str] = {}
    next_look = began + _LOOK_S
    while (now := time.monotonic()) < end:
        if now >= next_look:
            next_look = now + _LOOK_S
            _look_into_records(links)
        for link in links:
            link.send(now)
            _say_refusal(link.landing, refusals, say)
        if all(link.over(began, now) for link in links):
            return
        for fd, _ in poll.poll(_TURN_S * 1e3):
            owner, sock = owners[fd]
            owner.read(sock)


def _look_into_records(links: list[Link]) -> None:
    waiting = [link for link in links if not link.landing.confirmed and link.target.run is not None]
    for run in {link.target.run for link in waiting if link.target.run is not None}:
        down = told_down(run, [link.target.name for link in waiting if link.target.run == run])
        for link in waiting:
            if link.target.run == run:
                link.down = down.get(link.target.name, "")


def _say_refusal(landing: Landing, said: dict[str, str], say: Callable[[str], None]) -> None:
    if landing.refusal and said.get(landing.name) != landing.refusal:
        said[landing.name] = landing.refusal
        say(f"{landing.name}: {landing.refusal}; trying on")


def _open(address: tuple[str, int] | None) -> socket.socket:
    """address: the panic link's own end. If another holds it we still send: PX4 obeys every sender, but answers that one."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setblocking(False)
    if address is not None:
        with contextlib.suppress(OSError):
            sock.bind(address)
    return sock
