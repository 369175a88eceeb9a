"""Reception from the tools ports: the router sends telemetry to a viewer, and no vehicle receives anything from it."""

import select
import socket

from pymavlink.dialects.v20 import common as mavlink

from arena.live_view.tools_ports import PING_PERIOD_S, ToolsPorts, ping_router
from arena.mavlink_router.router import TOOL_TIMEOUT_S, Router
from arena.mavlink_router.routing_table import Table

HOST = "127.0.0.1"
REMOTE, VIEWER = (HOST, 24010), (HOST, 40001)
LOCAL, TOOLS = (HOST, 24011), (HOST, 24016)


def router():
    vehicle = {
        "name": "uav1",
        "id": 1,
        "simulated": False,
        "needs_operator": True,
        "link": {"local": LOCAL, "remote": REMOTE},
        "serve": (HOST, 24018),
        "clients": [],
        "logger": None,
        "tools": TOOLS,
    }
    return Router(
        Table.from_slice(
            {
                "vehicles": [vehicle],
                "gcs_local": (HOST, 24000),
                "gcs": [],
                "heartbeat": True,
                "simulated": False,
            }
        )
    )


def packed(message, system, component):
    return bytes(message.pack(mavlink.MAVLink(None, srcSystem=system, srcComponent=component)))


def send(core, sender, at, data, now=0.0):
    out = core.on_datagram(core.sockets.index(at), sender, data, now)
    return [(bytes(piece), address) for piece, places in out for _, address in places]


def test_ping_makes_a_tool_and_reaches_no_vehicle():
    core = router()
    telemetry = packed(mavlink.MAVLink_attitude_quaternion_message(1, 1, 0, 0, 0, 0, 0, 0), 1, 1)
    assert send(core, REMOTE, LOCAL, telemetry) == []
    assert send(core, VIEWER, TOOLS, packed(ping_router(), 255, 30)) == []
    assert send(core, REMOTE, LOCAL, telemetry) == [(telemetry, VIEWER)]


def test_ping_is_no_sign_of_an_operator_or_a_program():
    core = router()
    send(core, VIEWER, TOOLS, packed(ping_router(), 255, 30))
    assert not core.gcs_alive(0.0)
    assert core.commands.take_audit() == [] and core.commands.take_replies() == []


def test_pings_are_repeated_before_the_router_forgets_the_viewer():
    assert PING_PERIOD_S < TOOL_TIMEOUT_S / 3
    server = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    server.bind((HOST, 0))
    ports = ToolsPorts([None, server.getsockname()], lambda *_: None)
    for now, expected in ((0.0, True), (PING_PERIOD_S - 0.1, False), (PING_PERIOD_S, True)):
        ports.poll(now)
        ready, _, _ = select.select([server], [], [], 0.0)  # loopback delivers before `send` returns
        assert bool(ready) == expected
        if ready:
            server.recv(1000)
    ports.close()
    server.close()


def test_datagrams_are_passed_on_with_the_row_of_the_vehicle():
    servers = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
    received = []
    for server in servers:
        server.bind((HOST, 0))
    ports = ToolsPorts([s.getsockname() for s in servers], lambda *got: received.append(got))
    ports.poll(0.0)
    for server in reversed(servers):
        _, viewer = server.recvfrom(1000)
        server.sendto(f"from {servers.index(server)}".encode(), viewer)
    ports.poll(1.0)
    assert received == [(0, b"from 0", 1.0), (1, b"from 1", 1.0)]
    ports.close()
    for server in servers:
        server.close()


def test_missing_router_raises_nothing():
    free = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    free.bind((HOST, 0))
    address = free.getsockname()
    free.close()
    ports = ToolsPorts([address], lambda *_: None)
    for now in (0.0, 5.0, 10.0):
        ports.poll(now)
    ports.close()
