"""`python -m arena.fcu_link slice.json`: the wire to one flight controller, its three links, and the world of one in the loop."""

from __future__ import annotations

import contextlib
import json
import select
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

from arena.errors import ArenaError
from arena.fcu_link.core import SIMULATOR, FcuLink, Out
from arena.fcu_link.settings import Settings
from arena.fcu_link.simulator_client import World
from arena.fcu_link.transports import FcuTransport, open_transport
from arena.process_context import ProcessContext, ShutdownPolicy
from arena.transport import listen_udp, receive_datagrams
from arena.wire.qgc_params import format_params

_TICK_S = 0.05
_SECOND_S = 1.0
_HEADER = (
    "What {vehicle} must hold. In QGroundControl: Vehicle Setup > Parameters > Tools > Load from file, then reboot the vehicle.",
    "Load it twice: some parameters appear only after others are set.",
    "System  Component  Name  Value  Type",
)


class Shell:
    """Owns the sockets and the device. Each waiting one is served in turn, so that a flood on one starves no other."""

    def __init__(self, room: ProcessContext, settings: Settings) -> None:
        now = time.monotonic()
        self._room, self._s = room, settings
        self._core = FcuLink(settings, now)
        self._sockets = {
            name: listen_udp(ends.local, f"the {name} link") for name, ends in settings.links.items()
        }
        self._remotes = {name: ends.remote for name, ends in settings.links.items()}
        self._by_fd = {s.fileno(): name for name, s in self._sockets.items()}
        self._transport: FcuTransport = open_transport(settings.connection, self._core, now)
        core, simulator = self._core, settings.simulator
        self._world = World(simulator, core.counts, core.greeting()) if simulator is not None else None
        self._afterlife = ShutdownPolicy(limit_s=60.0 if settings.simulated else None)
        self._next_tick = self._next_second = now
        self._flow: Counter[str] = Counter()
        self._ready = self._over = self._typed = False
        self._placed: dict[str, Any] = {}
        self._write_params()

    def run(self) -> None:
        """Until told to stop; without a supervisor, until the vehicle is disarmed."""
        while not (self._room.stopping or self._over):
            self._wait()
            now = time.monotonic()
            for data, found in self._transport.read(now):
                self._send(self._core.from_wire(data, found, now))
            if self._world is not None:
                for data, found in self._world.read():
                    self._core.from_simulator(data, found, now)
            if now >= self._next_tick:
                self._tick(now)
            self._flush(now)
        self._report(time.monotonic())

    def close(self) -> None:
        self._transport.close()
        if self._world is not None:
            self._world.close()
        for s in self._sockets.values():
            s.close()

    def _wait(self) -> None:
        """For something to read, or room to write; what partners say is taken in here."""
        now = time.monotonic()
        poll = select.poll()
        for link in self._sockets.values():
            poll.register(link, select.POLLIN)
        if (wire := self._transport.fileno()) is not None:
            poll.register(wire, select.POLLIN | (select.POLLOUT if self._transport.wants_write() else 0))
        if self._world is not None and self._world.connected and (world := self._world.fileno()) is not None:
            poll.register(world, select.POLLIN)
        until = min(self._next_tick, now + 0.002) if len(self._core.outbox) else self._next_tick
        for fd, _ in poll.poll(max(0.0, 1e3 * (until - now))):
            if fd in self._by_fd:
                self._hear_partner(self._by_fd[fd])

    def _hear_partner(self, name: str) -> None:
        link, remote = self._sockets[name], self._remotes[name]
        for data, sender in receive_datagrams(link):
            if sender == remote or (
                name == "panic" and sender[0] == remote[0]
            ):  # a second land-all, as PX4 would hear it
                self._send(self._core.from_partner(name, data, time.monotonic()))
            else:
                self._core.counts[f"from {name}: stranger"] += 1

    def _send(self, out: Out) -> None:
        for end, data in out:
            if end == SIMULATOR:
                if self._world is not None:
                    self._world.write(data)
                continue
            with contextlib.suppress(OSError):  # nobody there yet: MAVLink is sent again
                self._sockets[end].sendto(data, self._remotes[end])

    def _flush(self, now: float) -> None:
        if not self._transport.write(lambda: self._core.next_out(now), now):
            self._core.outbox.clear()

    def _tick(self, now: float) -> None:
        self._next_tick = max(self._next_tick + _TICK_S, now)
        self._transport.tick(now)
        self._core.tick(now)
        if self._world is not None:
            self._world.tick(self._core.alive(now), now)
        self._tell()
        self._keep_place()
        if not self._typed and self._core.params.complete:
            self._write_params()
        orphaned = self._room.orphaned
        self._over = self._afterlife.over(orphaned=orphaned, any_armed=self._core.armed(now), now=now)
        if now >= self._next_second:
            self._report(now)
            self._next_second = max(self._next_second + _SECOND_S, now)

    def _tell(self) -> None:
        if not self._ready and self._core.ever_heard and self._core.params.complete:
            self._ready = True
            self._room.ready()
        for events in (self._transport.events, self._world.events if self._world is not None else []):
            for text in events:
                self._say(f"{self._s.vehicle}: {text}")
            events.clear()
        for text in self._core.events():
            self._say(text)

    def _say(self, text: str) -> None:
        print(text, flush=True)
        self._room.event(text)

    def _report(self, now: float) -> None:
        """Once a second; flows are of the last second."""
        flow, self._flow = self._core.flow - self._flow, Counter(self._core.flow)
        self._room.stats(
            {
                "from_vehicle_hz": flow["from_vehicle"],
                "to_vehicle_hz": flow["to_vehicle"],
                "poses_hz": flow["poses"],
                "partner": self._transport.peer(),
                "armed": self._core.armed(now),
                "may_not_arm": self._core.reasons(now),
                "dropped": dict(self._core.counts),
            }
        )

    def _keep_place(self) -> None:
        """For land-all, should this process end or hang: written whole, and only when it changes."""
        place = self._transport.last_address()
        if not self._s.wire_file or place == self._placed:
            return
        self._placed, path = place, Path(self._s.wire_file)
        half = path.with_name(path.name + ".new")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            half.write_text(json.dumps(place))
            half.replace(path)
        except OSError as error:
            self._say(f"{self._s.vehicle}: cannot write {path}: {error.strerror}")

    def _write_params(self) -> None:
        """At the start, and again with the vehicle's own types once they are known: a ground station minds them."""
        if not self._s.params_file or not self._s.params:
            return
        types = self._core.params.types
        self._typed = bool(types) and self._core.params.complete
        header = [line.format(vehicle=self._s.vehicle) for line in _HEADER]
        path = Path(self._s.params_file)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(format_params(self._s.params, self._s.id, header=header, types=types))
        except OSError as error:
            self._say(f"{self._s.vehicle}: cannot write {path}: {error.strerror}")


def main(argv: list[str] | None = None) -> int:
    try:
        room = ProcessContext.enter(argv)
        shell = Shell(room, Settings.from_slice(room.settings))
    except ArenaError as error:
        print(f"link: {error}", file=sys.stderr)
        return error.exit_code
    try:
        shell.run()
    finally:
        shell.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
