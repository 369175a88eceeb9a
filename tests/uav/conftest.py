from __future__ import annotations

import itertools
from collections.abc import Iterator

import pytest
from fake_autopilot import TELEMETRY, FakeAutopilot
from served import Address, Connection, Served, UdpPort, until

from arena.uav import UAV, connection, vehicle_control

CURVE = {"kind": "quadratic", "a": 34.068, "b": 7.1202, "fade_speed_m_s": 25.0}
STALE_S = 60.0
"""Age limit of the tests' vehicles [s]. A busy machine may stop the whole test for seconds, with the fake autopilot in it."""
_hosts = itertools.count(1)


def free_address() -> Address:
    """Return a UDP address that no other test of this process uses."""
    port = UdpPort((f"127.56.1.{next(_hosts) % 250 + 1}", 0))
    port.close()
    return port.address


def make_uav(address: Address, ns: str = "uav1", **more: object) -> UAV:
    given = {"link": f"udpin:{address[0]}:{address[1]}", "system_id": 1, "stale_s": STALE_S, **more}
    return UAV(ns, 1.52, 0.275, 0.1, 4, CURVE, **given)


def sending_to(address: Address, autopilot: FakeAutopilot) -> Served:
    """Serve an autopilot that sends its telemetry to the port of a program."""
    return Served([Connection(autopilot=autopilot, port=UdpPort(("127.56.2.1", 0)), remote=address)])


@pytest.fixture(autouse=True)
def short_times(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fake autopilot asks for no stream before OFFBOARD. Tests wait for heartbeats: they are more frequent.

    Tests count commands: a late reply of a busy machine causes no repetition.
    """
    monkeypatch.setattr(vehicle_control, "_STREAM_FIRST_S", 0.1)
    monkeypatch.setattr(vehicle_control, "_RETRY_S", 30.0)
    monkeypatch.setattr(connection, "_HEARTBEAT_S", 0.2)


@pytest.fixture
def address() -> Address:
    """Give the port of the program."""
    return free_address()


@pytest.fixture
def autopilot(address: Address) -> Iterator[FakeAutopilot]:
    """Give a disarmed autopilot on the floor, with all telemetry at 50 Hz. It lands only if a test sets land_s."""
    fake = FakeAutopilot(telemetry=tuple(TELEMETRY))
    with sending_to(address, fake):
        yield fake


@pytest.fixture
def backend() -> str:
    """Give the name of the backend. Modules whose tests hold for all backends replace this fixture."""
    return "mavlink"


@pytest.fixture
def uav(autopilot: FakeAutopilot, address: Address, backend: str) -> Iterator[UAV]:
    with make_uav(address, backend=backend) as one:
        until(lambda: one.ekf.age_s < 0.5 and one.info.is_connected)
        yield one
