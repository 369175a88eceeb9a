"""`python -m arena.autopilot.sitl_standin -d -i N [-s STARTUP] -w WORKDIR ROOTFS`: the built-in autopilot behind PX4's simulator API.

It has PX4's command line, startup scripts, links and lockstep, so that all of an arena's PX4 path runs where no PX4 is
installed. It is not PX4, and says so. What differs: docs/howto/fly-px4.md.
"""

from __future__ import annotations

import argparse
import errno
import fcntl
import os
import selectors
import signal
import socket
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import FrameType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.autopilots import Autopilots
from arena.autopilot.px4_startup import Startup, read_startup, rotors
from arena.errors import ArenaError, InputError, RunError
from arena.transport import listen_udp

Array = NDArray[np.float64]

BANNER = "arena's stand-in for PX4: the built-in autopilot behind PX4's simulator API. This is not PX4."
UP = "Startup script returned successfully"
FREE_RUN = 10
"""Samples that are not answered at first: PX4 looks for its sensors then."""
_MAG, _BARO = 0x1C0, 0x1A00
_CONTROLS, _ARMED, _LOCKSTEP = 16, 128, 1
_TRUTH_US = 5000.0
_AGAIN_S, _LOOK_S = 0.05, 0.2
_BYTES = 65536


class StandIn:
    """One vehicle, without its sockets: the simulator's byte stream and the links' datagrams in, and out.

    params: what the startup and the environment set. The sensor period is that between the first two samples.
    """

    def __init__(self, name: str, params: Mapping[str, float]) -> None:
        self._name, self._params, self._rotors = name, dict(params), rotors(params)
        self._codec = mavlink.MAVLink(None, srcSystem=int(params.get("MAV_SYS_ID", 1)), srcComponent=1)
        self._codec.robust_parsing = True
        self._pilot: Autopilots | None = None
        self._held = {"mag_b": np.zeros((1, 3)), "baro_alt_m": np.zeros(1)}
        self._first_us = 0
        self.samples = 0
        self.armed = False

    def greet(self) -> bytes:
        """What PX4 says when it has connected: how often it wants the truth, and that it is there."""
        wanted = mavlink.MAVLink_command_long_message(
            0,
            0,
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
            0,
            mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION,
            _TRUTH_US,
            0,
            0,
            0,
            0,
            0,
        )
        beat = mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_MODE_FLAG_HIL_ENABLED, 0, 0, 3
        )
        return self._pack(wanted) + self._pack(beat)

    def events(self) -> list[str]:
        return self._pilot.events() if self._pilot is not None else []

    def receive(self, link: str, data: bytes) -> None:
        """A datagram on a link (router, vision, panic)."""
        if self._pilot is not None:
            self._pilot.receive(0, link, data)

    def transmit(self) -> list[tuple[str, bytes]]:
        """What to send on the links after a step: (link, datagram)."""
        return [(link, data) for _, link, data in self._pilot.transmit()] if self._pilot is not None else []

    def hear(self, data: bytes) -> bytes:
        """A piece of the simulator's stream; returns what to answer: one HIL_ACTUATOR_CONTROLS a sample, once in step."""
        answers = b""
        for m in self._codec.parse_buffer(data) or []:
            if m.get_type() == "HIL_SENSOR" and m.id == 0:
                answers += self._sample(m)
            elif m.get_type() == "RC_CHANNELS" and self._pilot is not None:
                self._pilot.vehicles[0].manual_control.receive("radio", m.time_boot_ms * 1e-3)
        return answers

    def _sample(self, m: Any) -> bytes:
        self.samples += 1
        self._hold(m)
        if self.samples == 1:
            self._first_us = m.time_usec
        if self._pilot is None:
            dt = (m.time_usec - self._first_us) * 1e-6
            if dt <= 0.0:
                return b""
            self._pilot = self._make(dt)
        motors = self._pilot.step(m.time_usec * 1e-6, self._sensors(m))[0]
        self.armed = bool(self._pilot.armed[0])
        return self._controls(m.time_usec, motors) if self.samples > FREE_RUN else b""

    def _make(self, dt: float) -> Autopilots:
        profile = {"rotors": self._rotors, "params": {}}
        others = {k: v for k, v in self._params.items() if not k.startswith("CA_ROTOR")}
        vehicle = {
            "name": self._name,
            "id": int(self._params.get("MAV_SYS_ID", 1)),
            "profile": profile,
            "params": others,
        }
        return Autopilots({"vehicles": [vehicle]}, dt)

    def _hold(self, m: Any) -> None:
        """Magnetometer and barometer do not come with every sample."""
        if m.fields_updated & _MAG == _MAG:
            self._held["mag_b"] = np.array([[m.xmag, m.ymag, m.zmag]])
        if m.fields_updated & _BARO == _BARO:
            self._held["baro_alt_m"] = np.array([m.pressure_alt])

    def _sensors(self, m: Any) -> dict[str, Array]:
        """As the world gives them; the battery is always full."""
        return {
            "accel_b": np.array([[m.xacc, m.yacc, m.zacc]]),
            "gyro_b": np.array([[m.xgyro, m.ygyro, m.zgyro]]),
            **self._held,
            "battery_v": np.array([16.2]),
            "battery_current_a": np.array([0.0]),
            "battery_remaining": np.array([1.0]),
        }

    def _controls(self, time_usec: int, motors: Array) -> bytes:
        controls = np.zeros(_CONTROLS)
        controls[: len(motors)] = motors if self.armed else 0.0
        mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (_ARMED if self.armed else 0)
        return self._pack(
            mavlink.MAVLink_hil_actuator_controls_message(time_usec, controls.tolist(), mode, _LOCKSTEP)
        )

    def _pack(self, message: Any) -> bytes:
        data: bytes = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        return data


class Shell:
    """The stand-in's sockets: one TCP stream to the world, one UDP socket a link. Sensor samples are its only clock."""

    def __init__(self, startup: Startup, core: StandIn) -> None:
        assert startup.simulator is not None
        self._core, self._world = core, startup.simulator
        self._links = {link.name: (_bind(link.local, link.remote[0]), link.remote) for link in startup.links}
        self._stopping = False

    def run(self) -> None:
        """Until told to stop. Like PX4 it neither ends nor connects again when the simulator has gone."""
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        stream = self._connect()
        if stream is None:
            return
        with stream, selectors.DefaultSelector() as selector:
            stream.sendall(self._core.greet())
            selector.register(stream, selectors.EVENT_READ)
            while not self._stopping and self._turn(stream, selector):
                pass
            while not self._stopping:
                selector.select(_LOOK_S)

    def close(self) -> None:
        for made, _ in self._links.values():
            made.close()

    def _stop(self, signum: int, frame: FrameType | None) -> None:
        self._stopping = True

    def _connect(self) -> socket.socket | None:
        print(f"waiting for the simulator on TCP {self._world[0]}:{self._world[1]}", flush=True)
        with selectors.DefaultSelector() as pause:
            while not self._stopping:
                try:
                    stream = socket.create_connection(self._world, _LOOK_S)
                except OSError:
                    pause.select(_AGAIN_S)
                    continue
                stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                stream.settimeout(None)
                return stream
        return None

    def _turn(self, stream: socket.socket, selector: selectors.BaseSelector) -> bool:
        """Wait for samples and answer them; False once the simulator has gone."""
        if not selector.select(_LOOK_S):
            return True
        try:
            data = stream.recv(_BYTES)
            was_up = self._core.samples > 0
            self._drain()
            if data and (answers := self._core.hear(data)):
                stream.sendall(answers)
        except OSError:
            data = b""
        if not data:
            selector.unregister(stream)
            print("the simulator has closed its link; waiting to be ended", flush=True)
            return False
        if not was_up and self._core.samples:
            print(UP, flush=True)
        self._send()
        return True

    def _drain(self) -> None:
        for name, (link, _) in self._links.items():
            while True:
                try:
                    self._core.receive(name, link.recv(_BYTES))
                except BlockingIOError:
                    break
                except OSError:  # an answer of the network to something sent before
                    continue

    def _send(self) -> None:
        for name, data in self._core.transmit():
            link, remote = self._links.get(name, (None, None))
            if link is not None and remote is not None:
                try:
                    link.sendto(data, remote)
                except OSError:  # nobody there yet: MAVLink is sent again
                    continue
        for text in self._core.events():
            print(text, flush=True)


def _bind(port: int, partner: str) -> socket.socket:
    """On the partner's address where that is this computer's, so that arenas on several loopback addresses do not meet."""
    host = partner if partner.startswith("127.") else "0.0.0.0"
    return listen_udp((host, port), "the PX4 stand-in")


def take_lock(instance: int, host: str) -> IO[bytes]:
    """Held until this process ends. Raises RunError when another stand-in of this instance and address has it."""
    path = Path(tempfile.gettempdir()) / f"arena-standin-{os.getuid()}-{host}-{instance}.lock"
    file = path.open("ab")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        if error.errno not in (errno.EAGAIN, errno.EACCES):
            raise
        raise RunError(f"stand-in {instance} of {host} is already running ({path})") from None
    return file


def main(argv: list[str] | None = None) -> int:
    given = _arguments(argv)
    print(BANNER, flush=True)
    try:
        return _serve(given)
    except ArenaError as error:
        print(f"stand-in: {error}", file=sys.stderr, flush=True)
        return error.exit_code


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m arena.autopilot.sitl_standin", description=BANNER)
    parser.add_argument("-d", action="store_true", help="no shell, which there never is here")
    parser.add_argument("-i", type=int, default=0, metavar="N", help="instance")
    parser.add_argument(
        "-s", type=Path, metavar="STARTUP", help="startup script, default init.d-posix/rcS of ROOTFS"
    )
    parser.add_argument("-w", type=Path, default=Path(), metavar="WORKDIR", help="working folder")
    parser.add_argument("rootfs", type=Path, metavar="ROOTFS", help="the folder `etc` of the startup scripts")
    return parser.parse_args(argv)


def _serve(given: argparse.Namespace) -> int:
    if not given.w.is_dir():
        raise InputError(f"-w {given.w}: there is no such folder")
    script = given.w / (given.s or given.rootfs.absolute() / "init.d-posix" / "rcS")
    startup = read_startup(script, os.environ)
    for line in startup.skipped:
        print(f"not understood and passed over: {line}")
    assert startup.simulator is not None  # read_startup has seen to it
    with take_lock(given.i, startup.simulator[0]) as lock:
        shell = Shell(startup, StandIn(f"instance {given.i}", startup.params))
        try:
            shell.run()
        finally:
            shell.close()
            Path(lock.name).unlink(missing_ok=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
