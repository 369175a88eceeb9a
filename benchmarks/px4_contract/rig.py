"""Vehicle under test: a world with one PX4 or one built-in autopilot.

The script is the partner of all its MAVLink links.

The processes and their configurations are those of an arena's plan. No other process lies between the script
and the autopilot, so the recorded messages are exactly those of the autopilot. The script sleeps on the
simulation clock, and the world waits for it; so a step of the script is the same simulated time on any
computer. The arena's pose forwarder computes the poses from the true state.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.clock import SimClock
from arena.constants import INT32_NOT_GIVEN
from arena.errors import RunError
from arena.fault_injection import inject
from arena.mocap.client.pose import CapturedFrame, Pose
from arena.plan import make_plan
from arena.pose_forwarder.forwarder import Forwarder
from arena.schema import load_arena
from arena.wire.mavlink_frame import parse_frames
from arena.wire.px4_mode import mode_words
from arena.wire.truth_page import Truth, TruthReader

ME = (191, 18)  # component, MAV_TYPE
GROUND_STATION = (255, 190)  # system, component
TICK_S = 0.02
DELAY_S = 0.010
FAULTS = "faults"
UP_S, READY_S = 60.0, 60.0
RESULTS = {
    0: "accepted",
    1: "temporarily rejected",
    2: "denied",
    3: "unsupported",
    4: "failed",
    5: "in progress",
    6: "cancelled",
    7: "long only",
    8: "int only",
    9: "unsupported frame",
}
Each = Callable[["Rig"], None]


class Unfit(Exception):
    """Failure of the vehicle to reach the start state of a case."""


@dataclass(frozen=True, slots=True)
class Received:
    """Received message and its arrival time t [s].

    m: the decoded message, or the payload if the dialect lacks the message
    """

    t: float
    msgid: int
    name: str
    m: Any


@dataclass(kw_only=True)
class Setup:
    """Requirements of a case.

    params: parameters in addition to those of the arena
    poses: whether poses are sent from the start
    origin: whether the forwarder sends an origin
    yaml: additional lines of the arena file
    sticks: whether the arena file has `sticks: true` and the script simulates the radio
    """

    params: dict[str, float] = field(default_factory=dict)
    poses: bool = True
    origin: bool = True
    profile: dict[str, Any] = field(default_factory=dict)
    yaml: str = ""
    sticks: bool = False


class Link:
    """The script's end of one MAVLink link."""

    def __init__(self, settings: Mapping[str, Any], system: int, component: int = ME[0]) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self.socket.setblocking(False)
        self.socket.bind(tuple(settings["remote"]))
        self.remote = tuple(settings["local"])
        self.voice = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)

    def send(self, message: Any) -> None:
        with contextlib.suppress(OSError):
            self.socket.sendto(message.pack(self.voice), self.remote)
        self.voice.seq = (self.voice.seq + 1) % 256

    def datagrams(self) -> Iterator[bytes]:
        while True:
            try:
                yield self.socket.recv(65536)
            except OSError:
                return


class Rig:
    """A booted vehicle and the script's connections to it.

    received: all messages received on the router link since `clear`
    on_ground_link: the same for the ground station link
    station: whether the script sends the heartbeats of a ground station on the ground station link
    state: newest message of each kind
    """

    def __init__(
        self,
        links: Mapping[str, Any],
        clock: SimClock,
        truth: TruthReader,
        forwarder: dict[str, Any],
        system: int,
        faults: Path,
    ) -> None:
        self._faults = faults
        self.id, self.clock, self._truth = system, clock, truth
        senders = {"ground": GROUND_STATION}
        self.links = {name: Link(link, *senders.get(name, (system,))) for name, link in links.items()}
        self.counted: dict[str, Counter[str]] = {name: Counter() for name in links}
        self.received: list[Received] = []
        self.on_ground_link: list[Received] = []
        self.station = False
        self.state: dict[str, Any] = {}
        self.each: list[Each] = []
        self.poses = True
        self.shift = np.zeros(3)
        self.gcs = True
        self.sticks = False
        self.has_origin = forwarder["origin"] is not None
        self._forwarder = Forwarder(forwarder)
        self._body, self._rng = forwarder["body"], np.random.default_rng(1)
        self._custom_mode = 0
        self._number, self._next_beat, self._next = 0, 0.0, clock.now()

    # -- time --------------------------------------------------------------------------------------------------------------

    @property
    def now(self) -> float:
        return self.clock.now()

    def tick(self) -> None:
        """Run one step of the script: send, let the world step, receive."""
        for each in list(self.each):
            each(self)
        now = self.now
        if now >= self._next_beat:
            self._next_beat = now + 0.5
            if self.gcs:  # PX4 sends STATUSTEXT where it has heard a ground station
                self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
            if self.station:
                self.send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3), "ground")
        if self.sticks:  # PX4 takes these as its radio's
            self.send(mavlink.MAVLink_rc_channels_override_message(self.id, 1, *(1500,) * 8))
        self._see(now)
        self._next = max(self._next + TICK_S, now)
        self.clock.sleep_until(self._next)
        self._listen()

    def run(self, seconds: float) -> Rig:
        until = self.now + seconds
        while self.now < until - 1e-6:
            self.tick()
        return self

    def until(self, condition: Callable[[Rig], Any], limit_s: float) -> float | None:
        """Run steps until the condition is true; return the time this took [s], or None after `limit_s`."""
        begin = self.now
        while not condition(self):
            if self.now - begin > limit_s:
                return None
            self.tick()
        return self.now - begin

    # -- speaking ----------------------------------------------------------------------------------------------------------

    def send(self, message: Any, link: str = "router") -> None:
        self.links[link].send(message)

    def lose_rotor(self, rotor: int) -> None:
        """Set the thrust of one rotor (numbered from 1) to zero, from the next step on."""
        inject(self._faults, {"do": "motor", "vehicle": "uav1", "rotor": rotor, "thrust": 0.0})

    def command(
        self, number: int, *p: float, way: str = "long", frame: int = 0, to: tuple[int, int] | None = None
    ) -> str:
        """Send a command and return its acknowledgements in words.

        Returns `accepted`, `denied` and so on, several joined by `then`, or `none`.
        """
        system, component = to or (self.id, 1)
        q = [*p, *[0.0] * 7][:7]
        if way == "long":
            m = mavlink.MAVLink_command_long_message(system, component, number, 0, *q)
        else:
            x, y = (int(v) if math.isfinite(v) else INT32_NOT_GIVEN for v in q[4:6])
            m = mavlink.MAVLink_command_int_message(
                system, component, frame, number, 0, 0, *q[:4], x, y, q[6]
            )
        begin = len(self.received)
        self.send(m)
        self.until(lambda r: r._acks(begin, number), 1.5)
        self.run(0.3)
        acks = self._acks(begin, number)
        return " then ".join(dict.fromkeys(acks)) if acks else "none"

    def _acks(self, begin: int, number: int) -> list[str]:
        return [
            RESULTS.get(h.m.result, str(h.m.result))
            for h in self.received[begin:]
            if h.name == "COMMAND_ACK" and h.m.command == number
        ]

    def arm(self, *, force: bool = False) -> str:
        return self.command(400, 1, 21196 if force else 0)

    def disarm(self, *, force: bool = False) -> str:
        return self.command(400, 0, 21196 if force else 0)

    def set_mode(self, main: int, sub: int = 0) -> str:
        return self.command(176, 1, main, sub)

    def position(self, n: float, e: float, d: float, yaw: float = 0.0) -> Each:
        """Return a function for `each` that sends a position setpoint at every tick."""
        return lambda r: r.local(0b100111111000, (n, e, d), yaw=yaw)

    def local(
        self,
        mask: int,
        p: Any = (0, 0, 0),
        v: Any = (0, 0, 0),
        a: Any = (0, 0, 0),
        yaw: float = 0.0,
        rate: float = 0.0,
        frame: int = 1,
    ) -> None:
        m = mavlink.MAVLink_set_position_target_local_ned_message(
            int(self.now * 1e3), self.id, 1, frame, mask, *p, *v, *a, yaw, rate
        )
        self.send(m)

    # -- hearing -----------------------------------------------------------------------------------------------------------

    def clear(self) -> None:
        self.received.clear()
        self.on_ground_link.clear()
        for counted in self.counted.values():
            counted.clear()

    def all(self, name: str) -> list[Any]:
        return [h.m for h in self.received if h.name == name]

    def texts(self) -> list[tuple[int, str]]:
        """Return (severity, text) of each STATUSTEXT since `clear`."""
        return [(m.severity, m.text) for m in self.all("STATUSTEXT")]

    @property
    def mode(self) -> str:
        """Return the mode of the newest CURRENT_MODE or HEARTBEAT."""
        return mode_words(self._custom_mode)

    @property
    def armed(self) -> bool:
        return bool(self.state["HEARTBEAT"].base_mode & 128)

    def settle(self) -> Rig:
        """Run until a heartbeat that was sent after the last command has arrived (they are sent at 1 Hz)."""
        return self.run(1.15)

    @property
    def on_ground(self) -> bool:
        return bool(self.state["EXTENDED_SYS_STATE"].landed_state == 1)

    @property
    def may_arm(self) -> bool:
        status = self.state.get("SYS_STATUS")
        return bool(status and status.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK)

    def truth(self) -> Truth:
        found = self._truth.newest()
        assert found is not None
        return found

    @property
    def p_n(self) -> Any:
        """True position of the vehicle [m] [NED] (3,)."""
        return self.truth().p_n[0]

    def _listen(self) -> None:
        now = self.now
        for name, link in self.links.items():
            for data in link.datagrams():
                if name == "vision":
                    self._forwarder.on_mavlink(data, now)
                self._take(name, data, now)

    def _take(self, link: str, data: bytes, now: float) -> None:
        for frame in parse_frames(data).frames:
            known = mavlink.mavlink_map.get(frame.msgid)
            name = known.msgname if known else f"id {frame.msgid}"
            self.counted[link][name] += 1
            if link not in ("router", "ground"):
                continue
            m: Any = data[frame.payload : frame.payload + frame.size]
            if known:
                with contextlib.suppress(mavlink.MAVError, ValueError):
                    m = self.links[link].voice.decode(bytearray(data[frame.start : frame.end]))
            if link == "ground":
                self.on_ground_link.append(Received(now, frame.msgid, name, m))
                continue
            if known and not isinstance(m, bytes):
                self.state[name] = m
            if name == "HEARTBEAT" and known:
                self._custom_mode = m.custom_mode
            elif frame.msgid == 436:
                self._custom_mode = int.from_bytes(bytes(m[:4]).ljust(4, b"\0"), "little")
            self.received.append(Received(now, frame.msgid, name, m))

    # -- poses -------------------------------------------------------------------------------------------------------------

    def _see(self, now: float) -> None:
        """Send the simulated motion capture pose through the pose forwarder, delayed as in an arena."""
        self._number += 1
        truth = self._truth.at(now - DELAY_S)
        if self.poses and truth is not None:
            p = truth.p_n[0] + self.shift + self._rng.normal(0.0, 0.0003, 3)
            q = truth.q_nb[0]
            pose = Pose(self._body, tuple(p.tolist()), tuple(q.tolist()))
            data = self._forwarder.on_frame(CapturedFrame(self._number, now - DELAY_S, (pose,), ()), now)
            if data is not None:
                self.links["vision"].socket.sendto(data, self.links["vision"].remote)
        for data in self._forwarder.tick(now):
            with contextlib.suppress(OSError):
                self.links["vision"].socket.sendto(data, self.links["vision"].remote)

    def close(self) -> None:
        for link in self.links.values():
            link.socket.close()
        self.clock.close()


# -- processes -----------------------------------------------------------------------------------------------------------------


def arena_yaml(autopilot: str, setup: Setup, address: str, number: int) -> str:
    # By default PX4 drains its simulated battery in one minute.
    params = "".join(
        f"\n    {name}: {value}" for name, value in {"SIM_BAT_DRAIN": 10_000.0, **setup.params}.items()
    )
    given = f"\n  params:{params}" + ("\n  sticks: true" if setup.sticks else "")
    return (
        f"address: {address}\nworld: {{size: [60, 60, 30]}}\ndefaults:\n  profile: iris\n  autopilot: {autopilot}{given}\n"
        f"vehicles:\n  uav1: {{id: {number}}}\n{setup.yaml}"
    )


@contextlib.contextmanager
def vehicle(autopilot: str, setup: Setup, *, address: str, number: int, speed: str) -> Iterator[Rig]:
    """Start world and autopilot as in the plan, yield the booted vehicle, and end both in every case."""
    with tempfile.TemporaryDirectory(prefix="c-") as name:
        folder = Path(name)
        path = folder / "arena.yaml"
        path.write_text(arena_yaml(autopilot, setup, address, number))
        slices = {
            s["name"]: s
            for s in make_plan(load_arena(path, [f"sim.speed={speed}", "sim.processes=many"])).slices.values()
        }
        _merge(slices["world"]["vehicles"][0]["profile"], setup.profile)
        slices["world"]["vehicles"][0]["sticks"] = False  # the script is the radio
        slices["world"]["faults"] = f"{{rt}}/{FAULTS}"
        rooms = {"world": "px4_contract.obedient_world"} | (
            {"px4.uav1": "arena.px4"} if autopilot == "px4" else {}
        )
        with contextlib.ExitStack() as stack:
            children = [
                stack.enter_context(_room(module, slices[room], folder)) for room, module in rooms.items()
            ]
            clock = _clock(folder, children)
            links = (
                slices["px4.uav1"]["links"] if autopilot == "px4" else slices["world"]["vehicles"][0]["links"]
            )
            forwarder = slices["forward.uav1"] | {"frame_rate_hz": 50.0, "rate_hz": 50.0}
            if not setup.origin:
                forwarder["origin"] = None
            rig = Rig(links, clock, TruthReader(folder / "truth"), forwarder, number, folder / FAULTS)
            stack.callback(rig.close)
            rig.poses, rig.sticks = setup.poses, setup.sticks
            _boot(rig, folder)
            yield rig


def _merge(into: dict[str, Any], values: Mapping[str, Any]) -> None:
    for key, value in values.items():
        if isinstance(value, dict):
            _merge(into[key], value)
        else:
            into[key] = value


@contextlib.contextmanager
def _room(module: str, settings: dict[str, Any], folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    file = folder / f"{settings['name']}.json"
    file.write_text(json.dumps(settings).replace("{run}", str(folder)).replace("{rt}", str(folder)))
    path = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join(path)}
    with (folder / f"{settings['name']}.log").open("wb") as log:
        child = subprocess.Popen([sys.executable, "-m", module, str(file)], stdout=log, stderr=log, env=env)
        try:
            yield child
        finally:
            child.terminate()
            try:
                child.wait(10.0)
            except subprocess.TimeoutExpired:
                child.kill()
                child.wait()


def _clock(folder: Path, children: list[subprocess.Popen[bytes]]) -> SimClock:
    deadline = time.monotonic() + UP_S
    while True:
        if (folder / "truth").exists():
            with contextlib.suppress(RunError):  # its socket may be there and not listen yet
                return SimClock(folder / "clock", "contract")
        if time.monotonic() > deadline or any(c.poll() is not None for c in children):
            raise Unfit("the world has not come up: " + (folder / "world.log").read_text(errors="replace"))
        time.sleep(0.02)


def _boot(rig: Rig, folder: Path) -> None:
    """Wait until messages arrive, and until the vehicle is ready to arm if poses are sent.

    The world does not wait for the script while PX4 boots, so the time limit is in wall time.
    """
    deadline = time.monotonic() + READY_S
    known = {"HEARTBEAT", "SYS_STATUS"} | ({"LOCAL_POSITION_NED"} if rig.poses else set())
    ready = (lambda: rig.may_arm) if rig.poses and rig.has_origin else (lambda: known <= set(rig.state))
    while not ready():
        rig.tick()
        if time.monotonic() > deadline:
            logs = "".join(p.read_text(errors="replace")[-2000:] for p in folder.glob("*.log"))
            raise Unfit(f"the vehicle is not ready to arm after {READY_S:g} s; {rig.texts()[-5:]}\n{logs}")
    rig.run(1.0)
    rig.clear()
