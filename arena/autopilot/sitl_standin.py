"""The PX4 stand-in: a process that replaces PX4 SITL on machines without PX4.

    python -m arena.autopilot.sitl_standin -d -i N [-s STARTUP] -w WORKDIR ROOTFS

It runs the built-in autopilot behind PX4's simulator API. Command line, startup scripts, links and lockstep
are PX4's. docs/howto/fly-px4.md lists the differences.
"""

from __future__ import annotations

import argparse
import errno
import fcntl
import math
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
from arena.vehicle_models import DEFAULT_CLASS, VEHICLE_MODELS

Array = NDArray[np.float64]

BANNER = "arena's stand-in for PX4: the built-in autopilot behind PX4's simulator API. This is not PX4."
UP = "Startup script returned successfully"
FREE_RUN = 10
"""Number of first samples without a reply. PX4 does not reply while it looks for its sensors."""
MAX_GAP_S = 0.5
"""Longest gap between two sensor samples that is filled by interpolation [s].

Gaps occur with hardware in the loop: a computer that is late sends only the newest sample.
"""
_MAG, _BARO = 0x1C0, 0x1A00
_CONTROLS, _ARMED, _LOCKSTEP = 16, 128, 1
_TRUTH_US = 5000.0
_GEOMETRY = ("CA_ROTOR", "PWM_MAIN_FUNC", "MAV_TYPE")  # parameters that the built-in autopilot does not have
_RETRY_S, _POLL_S = 0.05, 0.2
_FULL_BATTERY = {
    "battery_v": np.array([16.2]),
    "battery_current_a": np.array([0.0]),
    "battery_remaining": np.array([1.0]),
}
_BYTES = 65536


class StandIn:
    """Replacement of PX4 SITL for one vehicle: the built-in autopilot with PX4's simulator API and MAVLink links.

    Opens no sockets: the caller passes received bytes in and sends the replies.

    The sensor period is the shortest time between two of the first FREE_RUN samples.

    params: parameters set by the startup script and the environment
    """

    def __init__(self, name: str, params: Mapping[str, float]) -> None:
        self._name, self._params, self._rotors = name, dict(params), rotors(params)
        self._codec = mavlink.MAVLink(None, srcSystem=int(params.get("MAV_SYS_ID", 1)), srcComponent=1)
        self._codec.robust_parsing = True
        self._autopilot: Autopilots | None = None
        self._held = {"mag_b": np.zeros((1, 3)), "baro_alt_m": np.zeros(1)}
        self._inertial: dict[str, Array] = {}
        self._last_us, self._period_us = 0, math.inf
        self.samples = 0
        self.armed = False

    def greeting(self) -> bytes:
        """Return the first bytes that PX4 sends to the simulator on a new connection.

        They contain a request for the true state at a given rate, and a HEARTBEAT.
        """
        request = mavlink.MAVLink_command_long_message(
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
        heartbeat = mavlink.MAVLink_heartbeat_message(
            VEHICLE_MODELS[DEFAULT_CLASS].mav_type(len(self._rotors)),
            mavlink.MAV_AUTOPILOT_PX4,
            mavlink.MAV_MODE_FLAG_HIL_ENABLED,
            0,
            0,
            3,
        )
        return self._pack(request) + self._pack(heartbeat)

    def events(self) -> list[str]:
        """Return the lines for the event log since the last call, for example about mode changes and failsafes."""
        return self._autopilot.events() if self._autopilot is not None else []

    def receive(self, link: str, data: bytes) -> None:
        """Pass a MAVLink datagram from one of the links to the autopilot.

        link: `router`, `vision`, `panic` or `ground`
        """
        if self._autopilot is not None:
            self._autopilot.receive(0, link, data)

    def transmit(self) -> list[tuple[str, bytes]]:
        """Return the MAVLink datagrams to send after a step, as (name of the link, datagram)."""
        return (
            [(link, data) for _, link, data in self._autopilot.transmit()]
            if self._autopilot is not None
            else []
        )

    def receive_simulator(self, data: bytes) -> bytes:
        """Process bytes from the simulator and return the reply.

        The reply has one HIL_ACTUATOR_CONTROLS per sample. The first FREE_RUN samples get no reply, as from
        PX4.
        """
        replies = b""
        for m in self._codec.parse_buffer(data) or []:
            if m.get_type() == "HIL_SENSOR" and m.id == 0:
                replies += self._sample(m)
            elif m.get_type() == "RC_CHANNELS" and self._autopilot is not None:
                self._autopilot.vehicles[0].manual_control.receive("radio", m.time_boot_ms * 1e-3)
        return replies

    def _sample(self, m: Any) -> bytes:
        self.samples += 1
        self._hold(m)
        passed_us, self._last_us = m.time_usec - self._last_us, m.time_usec
        if self._autopilot is None:
            if self.samples > 1 and passed_us > 0:
                self._period_us = min(self._period_us, passed_us)
            if self.samples < FREE_RUN or self._period_us == math.inf:
                return b""
            self._autopilot = self._make(self._period_us * 1e-6)
        motors = self._step(self._autopilot, m, passed_us)
        self.armed = bool(self._autopilot.armed[0])
        return self._controls(m.time_usec, motors) if self.samples > FREE_RUN else b""

    def _step(self, autopilot: Autopilots, m: Any, passed_us: float) -> Array:
        """Step the autopilot to the time of a HIL_SENSOR message, and return the motor outputs (rotors,) [-].

        If samples are missing, also step through the gap, with interpolated rates and accelerations. The
        estimator has a fixed step: without these steps it would lose the rotation during the gap.
        passed_us: time since the previous sample [us]
        """
        new = _inertial(m)
        old, self._inertial = self._inertial or new, new
        steps = round(passed_us / self._period_us)
        if not 1 < steps <= MAX_GAP_S * 1e6 / self._period_us:
            steps = 1
        for left in range(steps - 1, 0, -1):
            between = {name: new[name] + left / steps * (old[name] - new[name]) for name in new}
            time_s = (m.time_usec - left * self._period_us) * 1e-6
            autopilot.step(time_s, {**between, **self._held, **_FULL_BATTERY})
        motors: Array = autopilot.step(m.time_usec * 1e-6, {**new, **self._held, **_FULL_BATTERY})[0]
        return motors

    def _make(self, dt: float) -> Autopilots:
        profile = {"rotors": self._rotors, "params": {}}
        others = {k: v for k, v in self._params.items() if not k.startswith(_GEOMETRY)}
        vehicle = {
            "name": self._name,
            "id": int(self._params.get("MAV_SYS_ID", 1)),
            "profile": profile,
            "params": others,
        }
        return Autopilots({"vehicles": [vehicle]}, dt)

    def _hold(self, m: Any) -> None:
        """Store the magnetometer and barometer readings of a HIL_SENSOR message, if it contains them."""
        if m.fields_updated & _MAG == _MAG:
            self._held["mag_b"] = np.array([[m.xmag, m.ymag, m.zmag]])
        if m.fields_updated & _BARO == _BARO:
            self._held["baro_alt_m"] = np.array([m.pressure_alt])

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
    """Sockets of the PX4 stand-in: TCP to the simulator, and one UDP socket per MAVLink link.

    The sensor samples are the only clock of the stand-in.
    """

    def __init__(self, startup: Startup, core: StandIn) -> None:
        assert startup.simulator is not None
        self._core, self._world = core, startup.simulator
        self._links = {link.name: (_bind(link.local, link.remote[0]), link.remote) for link in startup.links}
        self._stopping = False

    def run(self) -> None:
        """Connect to the simulator and fly the vehicle until SIGTERM or SIGINT.

        If the simulator closes the connection, the process neither exits nor reconnects, as PX4 does not.
        """
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._stop)
        stream = self._connect()
        if stream is None:
            return
        with stream, selectors.DefaultSelector() as selector:
            stream.sendall(self._core.greeting())
            selector.register(stream, selectors.EVENT_READ)
            while not self._stopping and self._serve_samples(stream, selector):
                pass
            while not self._stopping:
                selector.select(_POLL_S)

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
                    stream = socket.create_connection(self._world, _POLL_S)
                except OSError:
                    pause.select(_RETRY_S)
                    continue
                stream.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                stream.settimeout(None)
                return stream
        return None

    def _serve_samples(self, stream: socket.socket, selector: selectors.BaseSelector) -> bool:
        """Reply to each sensor sample of the simulator with motor commands.

        Return False if the connection is closed.
        """
        if not selector.select(_POLL_S):
            return True
        try:
            data = stream.recv(_BYTES)
            was_up = self._core.samples > 0
            self._drain()
            if data and (replies := self._core.receive_simulator(data)):
                stream.sendall(replies)
        except OSError:
            data = b""
        if not data:
            selector.unregister(stream)
            print("the simulator has closed its connection; waiting for SIGTERM", flush=True)
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
                except OSError:  # an ICMP reply to an earlier datagram
                    continue

    def _send(self) -> None:
        for name, data in self._core.transmit():
            link, remote = self._links.get(name, (None, None))
            if link is not None and remote is not None:
                try:
                    link.sendto(data, remote)
                except OSError:  # no receiver yet; MAVLink repeats its messages
                    continue
        for text in self._core.events():
            print(text, flush=True)


def _inertial(m: Any) -> dict[str, Array]:
    """Return the acceleration [m/s^2] [FRD] and body rate [rad/s] [FRD] of a HIL_SENSOR message, each (1, 3)."""
    return {
        "accel_b": np.array([[m.xacc, m.yacc, m.zacc]]),
        "gyro_b": np.array([[m.xgyro, m.ygyro, m.zgyro]]),
    }


def _bind(port: int, partner: str) -> socket.socket:
    """Return a UDP socket bound to the port.

    If the partner has a loopback address, the socket is bound to that address only. So arenas on different
    loopback addresses may use the same port.
    """
    host = partner if partner.startswith("127.") else "0.0.0.0"
    return listen_udp((host, port), "the PX4 stand-in")


def take_lock(instance: int, host: str) -> IO[bytes]:
    """Lock a file until this process ends, to prevent a second stand-in with this instance number.

    Raises RunError if another stand-in with the same instance and address is running.
    """
    path = Path(tempfile.gettempdir()) / f"arena-standin-{os.getuid()}-{host}-{instance}.lock"
    file = open(path, "ab", opener=lambda name, flags: os.open(name, flags | os.O_NOFOLLOW, 0o600))  # noqa: SIM115 (held by the caller)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        if error.errno not in (errno.EAGAIN, errno.EACCES):
            raise
        raise RunError(
            f"PX4 stand-in {instance} at {host} is already running: stop it first (lock file {path})"
        ) from None
    return file


def main(argv: list[str] | None = None) -> int:
    given = _arguments(argv)
    print(BANNER, flush=True)
    try:
        return _serve(given)
    except ArenaError as error:
        print(f"PX4 stand-in: {error}", file=sys.stderr, flush=True)
        return error.exit_code


def _arguments(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m arena.autopilot.sitl_standin", description=BANNER)
    parser.add_argument("-d", action="store_true", help="no shell; accepted for compatibility with PX4")
    parser.add_argument("-i", type=int, default=0, metavar="N", help="instance number")
    parser.add_argument(
        "-s", type=Path, metavar="STARTUP", help="startup script, default init.d-posix/rcS of ROOTFS"
    )
    parser.add_argument("-w", type=Path, default=Path(), metavar="WORKDIR", help="working folder")
    parser.add_argument(
        "rootfs", type=Path, metavar="ROOTFS", help="folder that contains the startup scripts"
    )
    return parser.parse_args(argv)


def _serve(given: argparse.Namespace) -> int:
    if not given.w.is_dir():
        raise InputError(f"-w {given.w}: no such folder")
    script = given.w / (given.s or given.rootfs.absolute() / "init.d-posix" / "rcS")
    startup = read_startup(script, os.environ)
    for line in startup.skipped:
        print(f"startup script: line ignored, because the PX4 stand-in does not support it: {line}")
    assert startup.simulator is not None  # read_startup raises otherwise
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
