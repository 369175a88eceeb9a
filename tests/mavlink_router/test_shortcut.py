"""The shortcut for ordinary datagrams, compiled and interpreted, routes as the router does without it."""

import random

import pytest
from fleet import (
    GCS,
    LAND,
    OFFBOARD,
    TOOL,
    ack,
    attitude,
    command,
    heartbeat,
    landed_state,
    packed,
    slice_of,
    sys_status,
    timesync,
)
from pymavlink.dialects.v20 import common as mavlink

from arena.mavlink_router.router import Router
from arena.mavlink_router.routing_table import Table
from tests.kernels.kernel_versions import compiled_modules, interpreted_modules, needs_compiled

FAR = "192.168.7.9"


def setpoint(target, sender, component=1):
    message = mavlink.MAVLink_set_position_target_local_ned_message(
        7, target, component, 1, 0xDF8, *[0.5] * 11
    )
    return packed(message, *sender)


def position(z, system=1, component=1):
    return packed(mavlink.MAVLink_local_position_ned_message(7, 1.0, 2.0, z, 0, 0, 0), system, component)


def odometry(sender):
    message = mavlink.MAVLink_odometry_message(
        7, 1, 12, 1, 2, 3, [1, 0, 0, 0], *[0.0] * 6, [0.1] * 21, [0.1] * 21
    )
    return packed(message, *sender)


def signed(frame):
    """Return a MAVLink 2 frame with the flag of a signature and 13 more bytes; the CRC is then wrong."""
    return frame[:2] + b"\x01" + frame[3:] + bytes(13)


def unknown_message(frame):
    return frame[:7] + b"\xff\xff\x01" + frame[10:]


def version_1(system, component):
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(sender, force_mavlink1=True))


def frame_from_vehicle(rng, system):
    system = system if rng.random() < 0.97 else rng.choice((1, 2, 9))
    return rng.choice(
        (
            lambda: attitude(system),
            lambda: attitude(system, rng.choice((1, 154))),
            lambda: position(-rng.random(), system),
            lambda: position(float("nan"), system, rng.choice((1, 154))),
            lambda: heartbeat(system, armed=rng.random() < 0.8, mode=rng.choice((OFFBOARD, LAND))),
            lambda: landed_state(rng.randrange(4), system),
            lambda: sys_status(
                rng.choice((-1, 0, 50, 51)), system, rng.choice((1, 1, 154)), rng.randrange(9)
            ),
            lambda: ack(rng.choice(((1, 191), (255, 190), (1, 0), (0, 0))), system),
        )
    )()


def frame_from_client(rng, vehicle, sender):
    target = rng.choice((0, vehicle, vehicle, vehicle, 1, 2, 9))
    command_land = mavlink.MAVLink_command_long_message(target, 1, 176, 0, 1, 4, 6, 0, 0, 0, 0)
    return rng.choice(
        (
            lambda: setpoint(target, sender),
            lambda: setpoint(vehicle, sender),
            lambda: odometry(sender),
            lambda: odometry(sender),
            lambda: heartbeat(*sender),
            lambda: version_1(*sender),
            lambda: command(target, sender),
            lambda: packed(command_land, *sender),
            lambda: timesync(rng.choice((0, 5)), *sender),
            lambda: attitude(*sender),
        )
    )()


def damaged(rng, data):
    kind = rng.random()
    if kind < 0.9:
        return data
    if kind < 0.92:
        return signed(data)
    if kind < 0.94:
        return unknown_message(data)
    if kind < 0.96:
        return data[: rng.randrange(len(data))]
    changed = bytearray(data)
    changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def traffic(rng, table, routers):
    """Return (socket, sender, datagram) of a random sender."""
    v = rng.choice(table.vehicles)
    sockets = routers[0].sockets
    count = rng.choice((1, 1, 1, 2, 3, 40))
    if rng.random() < 0.5:
        frames = [frame_from_vehicle(rng, v.id) for _ in range(count)]
        place, sender = v.local, v.remote
        if v.ground is not None and rng.random() < 0.4:
            place, sender = v.ground.local, v.ground.remote
    else:
        mavlink_id = (v.id, rng.choice((191, 191, 191, 192, rng.randrange(2, 256))))
        place, sender = v.serve, rng.choice(v.clients)
        if rng.random() < 0.15:
            place, sender, mavlink_id = v.tools, TOOL, (rng.choice((250, 251, 253)), 190)
        elif rng.random() < 0.15:
            place, sender, mavlink_id = table.gcs_local, GCS, (255, 190)
        frames = [frame_from_client(rng, v.id, mavlink_id) for _ in range(count)]
    if rng.random() < 0.03:
        sender = rng.choice((("127.0.0.9", 9), table.vehicles[0].remote, table.vehicles[1].clients[0]))
    return sockets.index(place), sender, b"".join(damaged(rng, frame) for frame in frames)


def state(router):
    gates = router.commands._gates.values()
    return (
        {**vars(router.counts), "dropped": dict(+router.counts.dropped)},
        router.telemetry(),
        router.warnings(),
        router.changed_facts(),
        router.commands.changes(),
        router.commands.take_audit(),
        [(gate.authority.standing, gate.authority._program_setpoint_at, gate.refused) for gate in gates],
        [
            (endpoint.address, list(endpoint.senders))
            for v in router._vehicles
            for endpoint in v.clients.values()
        ],
    )


@needs_compiled
@pytest.mark.parametrize("seed", range(4))
def test_random_traffic_is_routed_alike_with_and_without_the_shortcut(seed):
    rng = random.Random(seed)
    raw = slice_of((1, 2), ground=(2,))
    raw["vehicles"][0]["clients"].append({"name": "far", "address": [FAR, 16101]})
    table = Table.from_slice(raw)
    kernels = [
        load("ordinary_datagrams")["ordinary_datagrams"].OrdinaryDatagrams
        for load in (compiled_modules, interpreted_modules)
    ]
    assert kernels[0] is not kernels[1]
    routers = [
        Router(table, use_shortcut=False),
        *(Router(table, use_shortcut=True, kernel=kernel) for kernel in kernels),
    ]
    now = 100.0
    for step in range(3000):
        now += rng.expovariate(20.0)
        socket, sender, data = traffic(rng, table, routers)
        outs = [
            [(bytes(piece), places) for piece, places in router.on_datagram(socket, sender, data, now)]
            for router in routers
        ]
        assert outs[0] == outs[1] == outs[2]
        for router in routers:
            if step % 50 == 0:
                router.tick(now)
            if step % 400 == 399:
                router.commands.on_request({"do": "release", "vehicle": "uav1", "by": "test"}, now)
        if step % 10 == 0:
            expected, *others = map(state, routers)
            for other in others:
                for mine, theirs in zip(expected, other, strict=True):
                    assert mine == theirs
    for router in routers[1:]:
        ordinary = router.shortcut.ordinary
        assert ordinary.versions[0] > 1, "the receivers have changed"
    assert routers[0].counts.frames_to_clients > 1000 and routers[0].counts.frames_to_vehicles > 500


@needs_compiled
def test_the_shortcut_takes_telemetry_setpoints_and_poses():
    table = Table.from_slice(slice_of((1, 2)))
    router = Router(table)
    v = table.vehicles[0]
    link, serve = router.sockets.index(v.local), router.sockets.index(v.serve)
    program = (1, 191)
    router.on_datagram(serve, v.clients[0], odometry(program), 1.0)  # the sender becomes known
    router.on_datagram(link, v.remote, attitude(1), 1.0)  # the receivers become known
    ordinary = [
        (link, v.remote, attitude(1) + position(-2.0, 1)),
        (serve, v.clients[0], setpoint(1, program)),
        (serve, v.clients[0], odometry(program)),
    ]
    for socket, sender, data in ordinary:
        assert router.shortcut.route(socket, sender, data, 2.0) is not None
    for socket, sender, data in (
        (serve, v.clients[0], command(1, program)),
        (serve, v.clients[0], timesync(0, *program)),
        (serve, v.clients[0], odometry((1, 7))),  # a new sender
        (link, v.remote, heartbeat(1)),
        (link, v.remote, ack(program, 1)),
    ):
        assert router.shortcut.route(socket, sender, data, 2.0) is None
    assert router.telemetry()["uav1"]["height_m"] == 2.0


@needs_compiled
@pytest.mark.parametrize(
    ("same", "new"),
    [
        (lambda v: sys_status(97, voltage_mv=12000 - v), sys_status(96)),
        (lambda v: landed_state(2), landed_state(1)),
    ],
    ids=["battery charge", "landed state"],
)
def test_status_is_ordinary_while_what_the_router_reads_does_not_change(same, new):
    table = Table.from_slice(slice_of((1,)))
    router = Router(table)
    link = router.sockets.index(table.vehicles[0].local)

    def routed(data):
        return router.shortcut.route(link, table.vehicles[0].remote, data, 1.0)

    router.on_datagram(link, table.vehicles[0].remote, attitude(1), 1.0)  # the receivers become known
    assert routed(same(0)) is None
    router.on_datagram(link, table.vehicles[0].remote, same(0), 1.0)
    assert routed(attitude(1) + same(1)) is not None
    assert routed(attitude(1) + new) is None
    router.on_datagram(link, table.vehicles[0].remote, new, 1.0)
    assert routed(same(2)) is None and routed(new) is not None
