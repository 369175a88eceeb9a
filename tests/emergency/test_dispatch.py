"""Order of reading and sending in land-all, without processes."""

from __future__ import annotations

import time
from types import SimpleNamespace

from emergency_fleet import flying
from served import until

from arena.emergency.dispatch import TargetConnections
from arena.emergency.landing_sequence import LandingSequence
from arena.transport import open_udp

K = 1


class FakeDirectLink:
    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def step(self, silent_s: float, now: float, *, needed: bool) -> None: ...

    def send(self, frames: list[bytes], now: float) -> None:
        self.sent += frames

    def files(self) -> tuple[int, ...]:
        return ()


def connections_after_a_pause(mode: str) -> tuple[TargetConnections, FakeDirectLink]:
    """Return the connections to an armed vehicle, whose heartbeat waits in the socket for longer than the first second."""
    autopilot, router = open_udp(("127.66.200.1", 0)), open_udp(("127.66.200.1", 0))
    made, direct = TargetConnections.__new__(TargetConnections), FakeDirectLink()
    now = time.monotonic()
    made.target = SimpleNamespace(name="uav1", autopilot=autopilot.getsockname(), tools=("127.66.200.1", 9))
    made.landing = LandingSequence(
        name="uav1", system=K, component=1, action="land", now=now - 5.0, radio="required"
    )
    made.router, made.panic, made._direct, made._relayed = router, None, direct, None
    made._began, made._next_bind, made._say_once = now - 5.0, now + 60.0, lambda text: None
    fake = flying(K, mode=mode)
    autopilot.sendto(fake.state(0.0), router.getsockname())
    until(lambda: bool(made.router.recv(1, 2)))  # MSG_PEEK: it has arrived
    autopilot.close()
    return made, direct


def test_pilot_whose_heartbeat_waited_during_a_pause_is_not_bypassed() -> None:
    made, direct = connections_after_a_pause("POSCTL")
    made.send(time.monotonic())
    assert made.landing.reported.armed and direct.sent == []
    made.router.close()


def test_vehicle_that_no_pilot_flies_is_commanded_directly() -> None:
    made, direct = connections_after_a_pause("OFFBOARD")
    made.send(time.monotonic())
    assert direct.sent
    made.router.close()
