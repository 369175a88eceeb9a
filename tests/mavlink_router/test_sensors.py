"""Measurements of emulated sensors in the router: who receives them, and what is refused."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.live_view.tools_ports import ping_router
from arena.mavlink_router.router import Router
from arena.mavlink_router.routing_table import Table
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_ids import SENSORS_COMPONENT
from arena.wire.relative_measurements import (
    DEBUG_FLOAT_ARRAY,
    NeighbourMeasurement,
    measurement_payload,
)

HOST = "127.0.0.1"
SENDER, RECORDER, STATION, VIEWER = (HOST, 24003), (HOST, 24002), (HOST, 14550), (HOST, 40001)
PROGRAM, SDK = (HOST, 16001), (HOST, 22001)
AT, TOOLS = (HOST, 24017), (HOST, 24016)
MEASURED = NeighbourMeasurement(1.0, 2, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3), 0.01, 0.01)


def vehicle(number: int, **more: object) -> dict[str, object]:
    base = 24000 + 10 * number
    return {
        "name": f"uav{number}",
        "id": number,
        "link": {"local": (HOST, base + 1), "remote": (HOST, base)},
        "serve": (HOST, base + 8),
        "clients": [{"address": (HOST, 16000 + number)}, {"address": (HOST, 22000 + number)}],
        "tools": (HOST, base + 6),
        "sensors": (HOST, base + 7),
        **more,
    }


@pytest.fixture
def router() -> Router:
    return Router(
        Table.from_slice(
            {
                "vehicles": [vehicle(1), vehicle(2, sensors=None)],
                "gcs_local": (HOST, 24000),
                "gcs": [{"address": STATION}],
                "recorder": RECORDER,
                "sensors": SENDER,
                "heartbeat": True,
                "simulated": True,
            }
        )
    )


def measurement(system: int = 1, component: int = SENSORS_COMPONENT) -> bytes:
    return Codec(system, component).frame(DEBUG_FLOAT_ARRAY, measurement_payload(MEASURED))


def send(router: Router, data: bytes, sender: tuple[str, int] = SENDER) -> dict[tuple[str, int], bytes]:
    out = router.on_datagram(router.sockets.index(AT), sender, data, 0.0)
    return {address: bytes(piece) for piece, places in out for _, address in places}


def test_measurements_go_to_program_sdk_and_recorder_but_not_to_ground_stations(router: Router) -> None:
    assert send(router, measurement()) == dict.fromkeys((RECORDER, PROGRAM, SDK), measurement())


def test_program_receives_measurements_from_the_address_of_its_vehicle(router: Router) -> None:
    """A program replies to the sender: another address would get the commands for the vehicle."""
    out = router.on_datagram(router.sockets.index(AT), SENDER, measurement(), 0.0)
    serve = router.sockets.index((HOST, 24018))
    assert {key for _, places in out for key, _ in places} == {serve}


def test_tools_receive_measurements(router: Router) -> None:
    ping = Codec(255, 30).pack(ping_router())
    router.on_datagram(router.sockets.index(TOOLS), VIEWER, ping, 0.0)
    assert VIEWER in send(router, measurement())


def test_only_the_process_sensors_may_send(router: Router) -> None:
    assert send(router, measurement(), sender=VIEWER) == {}
    assert router.counts.dropped["unknown sender on the sensors' socket"] == 1


@pytest.mark.parametrize(
    "data",
    [
        measurement(system=2),
        measurement(component=1),
        measurement() + Codec(1, 1).pack(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)),
        Codec(1, SENSORS_COMPONENT).pack(
            mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
        ),
        b"no frame",
        b"",
    ],
    ids=["another vehicle", "autopilot", "with a heartbeat", "command", "garbage", "empty"],
)
def test_other_messages_are_not_forwarded(router: Router, data: bytes) -> None:
    assert send(router, data) == {}


def test_nothing_is_sent_to_a_vehicle(router: Router) -> None:
    assert not set(send(router, measurement())) & {(HOST, 24010), (HOST, 24020)}
    assert router.counts.frames_to_vehicles == 0


def test_vehicle_without_sensors_has_no_socket_for_them(router: Router) -> None:
    assert (HOST, 24027) not in router.sockets and list(router.sensor_sockets) == ["uav1"]
