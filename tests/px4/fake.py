"""A fake PX4 for tests of the simulator API: a TCP client that replies to samples, in a thread of its own."""

from __future__ import annotations

import itertools
import os
import socket
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.px4.lockstep import Px4Links
from arena.sim.sensors import hil_outputs

_count = itertools.count(1)
LOCKSTEP, ARMED = 1, 128
PERIOD_S = 0.004
HIL = hil_outputs()


def own_address() -> str:
    """Return an address 127.60.x.y that no other test uses."""
    return f"127.60.{os.getpid() % 250 + 1}.{next(_count)}"


def answer(motors: list[float], *, armed: bool = True, time_usec: int = 0, flags: int = LOCKSTEP) -> bytes:
    """Return a HIL_ACTUATOR_CONTROLS as PX4 packs it."""
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    controls = [*motors, *[0.0] * (16 - len(motors))]
    m = mavlink.MAVLink_hil_actuator_controls_message(time_usec, controls, ARMED if armed else 0, flags)
    return bytes(m.pack(codec))


def first_messages() -> bytes:
    """Return PX4's first messages on a new connection: the rate of the truth, and a heartbeat."""
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    wanted = mavlink.MAVLink_command_long_message(0, 0, 511, 0, 115, 5000, 0, 0, 0, 0, 0)
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3)
    return bytes(wanted.pack(codec)) + bytes(beat.pack(codec))


def sensors(vehicles: int) -> dict[str, Any]:
    """Return sensor readings of vehicles at rest, as the world gives them to autopilots."""
    return {
        "accel_b": np.tile([0.01, -0.02, -9.81], (vehicles, 1)),
        "gyro_b": np.tile([0.001, 0.002, -0.003], (vehicles, 1)),
        "mag_b": np.tile([0.2, 0.01, 0.43], (vehicles, 1)),
        "baro_alt_m": np.linspace(488.0, 489.0, vehicles),
    }


class FakePx4:
    """A fake PX4: connects, then replies to every sample after the first `free_run` with `motors`.

    flags: 0 for a flight controller in the loop.
    """

    def __init__(
        self,
        address: tuple[str, int],
        motors: list[float],
        free_run: int = 3,
        armed: bool = True,
        flags: int = LOCKSTEP,
    ) -> None:
        self.samples: list[Any] = []
        self._flags = flags
        self._motors, self._free_run, self._armed = motors, free_run, armed
        self._reading = threading.Event()
        self._reading.set()
        self._socket = socket.create_connection(address, 5.0)
        self._socket.settimeout(None)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # as PX4 does
        self._socket.sendall(first_messages())
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def stop_reading(self) -> None:
        """Stop reading, as a stopped process does."""
        self._reading.clear()

    def resume_reading(self) -> None:
        self._reading.set()

    def disconnect(self) -> None:
        self._reading.set()
        self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join(5.0)
        self._socket.close()

    def _serve(self) -> None:
        codec = mavlink.MAVLink(None)
        codec.robust_parsing = True
        while True:
            try:
                data = self._socket.recv(65536)
            except OSError:
                return
            if not data:
                return
            for m in codec.parse_buffer(data) or []:
                if m.get_type() == "HIL_SENSOR":
                    self.samples.append(m)
                    self._reading.wait()
                    if len(self.samples) > self._free_run:
                        self._reply(m.time_usec)

    def _reply(self, time_usec: int) -> None:
        try:
            self._socket.sendall(
                answer(self._motors, armed=self._armed, time_usec=time_usec, flags=self._flags)
            )
        except OSError:
            return


class World:
    """A world without physics that steps the lockstep links of some vehicles."""

    def __init__(self, vehicles: int, *, lockstep: bool = False) -> None:
        self.address = own_address()
        self.places = [(self.address, 24000 + 10 * k + 9) for k in range(1, vehicles + 1)]
        profile = {"rotors": [{"position_m": [0, 0, 0], "direction": "cw"}] * 4}
        self.links = Px4Links(
            [
                {"name": f"uav{k}", "simulator": list(place), "profile": profile, "lockstep": lockstep}
                for k, place in enumerate(self.places, 1)
            ],
            None,
            HIL,
        )
        self.events: list[str] = []
        self.now = 0.0
        self._sensors = sensors(vehicles)

    def step(self, times: int = 1) -> Any:
        for _ in range(times):
            self.now += PERIOD_S
            motors = self.links.step(self.now, self._sensors)
            self.events += self.links.events()
        return motors

    def until(self, true: Callable[[], Any], limit_s: float = 40.0) -> Any:
        """Step until a condition holds and return its value."""
        deadline = time.monotonic() + limit_s
        while not (found := true()):
            assert time.monotonic() < deadline, (self.events, self.status())
            self.step()
            time.sleep(0.001)  # the fake PX4s keep up, also on a busy machine
        return found

    def status(self) -> list[str]:
        return [told["px4"] for told in self.links.stats().values()]

    def until_in_step(self) -> None:
        self.until(lambda: set(self.status()) == {"in step"})
