"""Loop of `arena fly` by hand: reads keys and gamepad, sends stick positions at 50 Hz, prints the state.

The loop runs on the wall clock, and no process of the arena waits for it. If the terminal is lost, or the process is killed or paused, no
stick positions are sent any more, and the autopilot's failsafe for lost manual control acts.
"""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from typing import Protocol

from arena.errors import EXIT_FAILED, EXIT_OK, InputError, RunError
from arena.fly.keyboard import HELP, Keyboard, parse_keys
from arena.fly.pilot import Pilot
from arena.fly.running_vehicle import RunningVehicle, lock_pilot
from arena.transport import open_udp
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import PILOT_PING
from arena.wire.router_ping import ping_router
from arena.wire.sticks import Sticks

RATE_HZ = 50.0
_LINE_S = 0.1
_CONNECT_S = 5.0
_LAND_S = 60.0
_SILENT_S = 10.0  # without a heartbeat the arena has ended, or the vehicle is lost
_LARGEST = 1 << 16


class SticksSource(Protocol):
    """Interface of a device with sticks, such as `arena.fly.gamepad.Gamepad`."""

    def poll(self) -> tuple[Sticks | None, list[str]]: ...


class HandFlight:
    """Flight of one vehicle by hand, from a terminal.

    send: function that sends a frame to the vehicle. show: function that shows a line
    gamepad: gamepad with the sticks; None flies with the keys
    """

    def __init__(
        self,
        pilot: Pilot,
        send: Callable[[bytes], None],
        show: Callable[[str], None],
        gamepad: SticksSource | None = None,
    ) -> None:
        self._pilot, self._send, self._show, self._gamepad = pilot, send, show, gamepad
        self._keyboard = Keyboard()
        self._next_line, self._landing_since, self._connected_at = 0.0, 0.0, 0.0
        self.result: int | None = None

    def on_keys(self, data: bytes, now: float) -> None:
        """Process the keys that the person has pressed, as bytes from the terminal.

        No bytes mean that the terminal is lost. The flight by hand then ends without a command.
        """
        if not data:
            self.result = EXIT_FAILED
        for key in parse_keys(data):
            self._act(self._keyboard.press(key, now), now)

    def interrupt(self, now: float) -> None:
        """Land and quit (Ctrl-C).

        If the vehicle is landing already, quit at once.
        """
        self._act("quit", now)

    def tick(self, now: float) -> None:
        """Send stick positions and requests, and show the state. Call this RATE_HZ times a second."""
        sticks: Sticks | None = self._keyboard.sticks(now)
        if self._gamepad is not None:
            sticks, actions = self._gamepad.poll()
            for action in actions:
                self._act(action, now)
        if self._landing_since:
            sticks = Sticks() if sticks is not None else None  # moved sticks would end the landing
        for frame in self._pilot.frames(sticks, now):
            self._send(frame)
        if now >= self._next_line:
            self._next_line = now + _LINE_S
            lost = "" if sticks is not None else "  GAMEPAD LOST"
            self._show(self._pilot.status(now) + lost)
        if self._pilot.state(now) is not None or not self._connected_at:
            self._connected_at = now
        if self._landing_since:
            self._watch_landing(now)
        elif now - self._connected_at > _SILENT_S:
            self._show(
                f"{self._pilot.status(now)} for {_SILENT_S:g} s: the arena has ended, or the vehicle is lost"
            )
            self.result = EXIT_FAILED

    def _act(self, action: str, now: float) -> None:
        if action == "quit":
            self._quit(now)
        elif action == "arm" and (state := self._pilot.state(now)) is not None and not state[1]:
            self._pilot.request("arm", now)
        elif action and action != "arm":
            self._landing_since = 0.0
            self._pilot.request(action, now)

    def _quit(self, now: float) -> None:
        if self._landing_since or not self._pilot.must_land(now):
            self.result = EXIT_OK if not self._landing_since else EXIT_FAILED
        else:
            self._landing_since = now
            self._pilot.request("AUTO.LAND", now)

    def _watch_landing(self, now: float) -> None:
        state = self._pilot.state(now)
        if state is not None and not state[1]:
            self.result = EXIT_OK
        elif now - self._landing_since > _LAND_S:
            self._show(f"{self._pilot.status(now)}  LANDING NOT CONFIRMED")
            self.result = EXIT_FAILED
        elif not self._pilot.is_busy and state is not None and state[0] not in ("AUTO.LAND", "DESCEND"):
            self._pilot.request("AUTO.LAND", now)


def fly_by_hand(vehicle: RunningVehicle, gamepad: SticksSource | None = None) -> int:
    """Fly a vehicle by hand in this terminal until the person quits. Return the exit code.

    Raises InputError without a terminal and if the simulation is faster than real time. Raises RunError if another person flies the
    vehicle or the vehicle does not obey joysticks.
    """
    if not sys.stdin.isatty():
        raise InputError(
            "arena fly: stdin is not a terminal. A trajectory file needs no terminal: arena fly VEHICLE FILE"
        )
    if vehicle.speed > 1.0:
        raise InputError(
            f"{vehicle.name}: the simulation is faster than real time, and stick positions are sent in real time. "
            "Start the arena with --speed 1 to fly by hand"
        )
    assert vehicle.settings.tools is not None
    with contextlib.closing(lock_pilot(vehicle)), _terminal():
        sock = open_udp((vehicle.settings.tools[0], 0))
        sock.connect(vehicle.settings.tools)
        sock.setblocking(False)

        def send(frame: bytes) -> None:
            with contextlib.suppress(OSError):  # no router receives it: the failsafe acts
                sock.send(frame)

        pilot = Pilot(vehicle.name, vehicle.settings.id)
        send(Codec(PILOT_PING.system, PILOT_PING.component).pack(ping_router()))
        flight = HandFlight(pilot, send, _show, gamepad)

        def receive() -> None:
            with contextlib.suppress(OSError):
                while True:
                    pilot.on_datagram(sock.recv(_LARGEST), time.monotonic())

        with contextlib.closing(sock):
            _wait_for_source(pilot, send, receive)
            print(f"{HELP}\n", flush=True)
            return _loop(flight, receive)


def _wait_for_source(pilot: Pilot, send: Callable[[bytes], None], receive: Callable[[], None]) -> None:
    """Wait until the vehicle reports that it obeys joysticks.

    Raises RunError if the vehicle ignores joysticks, or does not reply.
    """
    end, next_request = time.monotonic() + _CONNECT_S, 0.0
    while pilot.source is None or pilot.state(time.monotonic()) is None:
        now = time.monotonic()
        if now > end:
            raise RunError(f"{pilot.name}: no reply from the vehicle within {_CONNECT_S:g} s")
        if now >= next_request:
            next_request = now + 0.5
            send(pilot.source_request())
        receive()
        time.sleep(0.02)
    if problem := pilot.source_problem():
        raise RunError(problem)


def _loop(flight: HandFlight, receive: Callable[[], None]) -> int:
    next_tick = time.monotonic()
    while flight.result is None:
        try:
            readable, _, _ = select.select([sys.stdin], [], [], max(0.0, next_tick - time.monotonic()))
            if readable:
                flight.on_keys(os.read(sys.stdin.fileno(), 256), time.monotonic())
            receive()
            if time.monotonic() >= next_tick:
                next_tick = max(next_tick + 1.0 / RATE_HZ, time.monotonic())
                flight.tick(time.monotonic())
        except KeyboardInterrupt:
            flight.interrupt(time.monotonic())
    print(flush=True)
    return flight.result


def _show(line: str) -> None:
    sys.stdout.write(f"\r\x1b[K{line[:150]}")
    sys.stdout.flush()


@contextlib.contextmanager
def _terminal() -> Iterator[None]:
    """Read single keys without echo during a `with` block. Ctrl-C still interrupts."""
    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield
    finally:
        with contextlib.suppress(termios.error):
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)
