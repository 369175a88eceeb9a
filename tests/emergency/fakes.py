"""Minimal autopilots for land-all: they use pymavlink, on a panic link and behind a router."""

import random
import select
import socket
import threading
import time
from dataclasses import dataclass, field

from pymavlink.dialects.v20 import common as mavlink

from arena.emergency.targets import Target

LAND, OFFBOARD = 4 << 16 | 6 << 24, 6 << 16
GROUND, AIR = mavlink.MAV_LANDED_STATE_ON_GROUND, mavlink.MAV_LANDED_STATE_IN_AIR
FORCE = 21196


def target(k, host, name=""):
    base = 24000 + 10 * k
    return Target(
        name=name or f"uav{k}",
        id=k,
        autopilot=(host, base + 4),
        partner=(host, base + 5),
        tools=(host, base + 6),
    )


@dataclass(kw_only=True)
class Fake:
    """The behaviour of a vehicle, without sockets: commands in, acknowledgements out, state by time.

    obeys: accepts land commands
    disarms: by itself after the landing
    commands: every received command
    received: (system, component, type) of every received message
    """

    system: int
    armed: bool = True
    landed: bool = False
    mode: int = OFFBOARD
    obeys: bool = True
    disarms: bool = True
    land_s: float = 0.2
    commands: list = field(default_factory=list)
    landing_since: float | None = None
    received: set = field(default_factory=set)

    def __post_init__(self):
        self._sender = mavlink.MAVLink(None, srcSystem=self.system, srcComponent=1)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True

    def pack(self, message):
        return bytes(message.pack(self._sender))

    def step(self, now):
        if self.mode == LAND and self.landing_since is None:
            self.landing_since = now
        if self.landing_since is not None and now - self.landing_since > self.land_s:
            self.landed = True
            self.armed = self.armed and not self.disarms

    def state(self):
        return [
            self.pack(mavlink.MAVLink_heartbeat_message(2, 12, 1 | 128 * self.armed, self.mode, 4, 3)),
            self.pack(mavlink.MAVLink_extended_sys_state_message(0, GROUND if self.landed else AIR)),
        ]

    def receive(self, data):
        """Take in a datagram. Return the answers."""
        answers = []
        for m in self._parser.parse_buffer(data) or []:
            self.received.add((m.get_srcSystem(), m.get_srcComponent(), m.get_type()))
            if m.get_type() == "COMMAND_LONG" and m.target_system == self.system:
                result = self.obey(m)
                self.commands.append((m.command, m.param1, m.param2))
                answers.append(
                    self.pack(
                        mavlink.MAVLink_command_ack_message(
                            m.command, result, 0, 0, m.get_srcSystem(), m.get_srcComponent()
                        )
                    )
                )
        return answers

    def obey(self, m):
        if m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            if not (self.landed or m.param2 == FORCE):
                return mavlink.MAV_RESULT_DENIED
            self.armed = bool(m.param1)
        elif m.command in (mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_CMD_NAV_LAND):
            if not self.obeys:
                return mavlink.MAV_RESULT_DENIED
            if m.command == mavlink.MAV_CMD_NAV_LAND or (m.param2, m.param3) == (4, 6):
                self.mode = LAND
        return mavlink.MAV_RESULT_ACCEPTED


class Fleet:
    """Fakes on sockets, in one thread.

    paths: "panic" link, "tools" (in place of the router), "router" (link of a real router), "wire" (a real vehicle on UDP)
    loss: share of datagrams that are lost in each direction
    """

    def __init__(self, fakes, host, paths=("panic", "tools"), loss=0.0):
        self.fakes, self.loss, self.rng = {f.system: f for f in fakes}, loss, random.Random(1)
        self.targets = [target(k, host) for k in self.fakes]
        self.ways, self.guests = [], {}
        self.first_command = {}
        for t in self.targets:
            for path in paths:
                s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                s.setblocking(False)
                link = host, 24000 + 10 * t.id
                own, partner = {
                    "panic": (t.autopilot, t.partner),
                    "tools": (t.tools, None),
                    "router": (link, (host, link[1] + 1)),
                    "wire": ((host, 25000 + t.id), (host, 14540 + t.id)),
                }[path]
                s.bind(own)
                self.ways.append((s, t.id, partner))
        self.wake, self.stop = socket.socketpair()
        self.thread = threading.Thread(target=self.run)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.stop.send(b"x")
        self.thread.join(10)
        for s, *_ in self.ways:
            s.close()
        self.wake.close()
        self.stop.close()
        assert not self.thread.is_alive()

    def run(self):
        due = 0.0
        while True:
            ready, _, _ = select.select([self.wake, *(w[0] for w in self.ways)], [], [], 0.02)
            if self.wake in ready:
                return
            for way in self.ways:
                if way[0] in ready:
                    self.read(way)
            if (now := time.monotonic()) > due:
                due = now + 0.05
                self.send_state(now)

    def read(self, way):
        s, k, partner = way
        while True:
            try:
                data, sender = s.recvfrom(4096)
            except OSError:
                return
            for answer in () if self.lost() else self.fakes[k].receive(data):
                self.send(s, answer, partner or sender)
            if self.fakes[k].commands:
                self.first_command.setdefault(k, time.monotonic())
            if partner is None:
                self.guests[s.fileno(), sender] = s, k

    def send_state(self, now):
        for fake in self.fakes.values():
            fake.step(now)
        for s, k, partner in self.ways:
            if partner is not None:
                for frame in self.fakes[k].state():
                    self.send(s, frame, partner)
        for (_, sender), (s, k) in self.guests.items():
            for frame in self.fakes[k].state():
                self.send(s, frame, sender)

    def send(self, s, frame, dest):
        if not self.lost():
            s.sendto(frame, dest)

    def lost(self):
        return self.rng.random() < self.loss
