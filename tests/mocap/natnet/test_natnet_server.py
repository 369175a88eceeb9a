"""The emulated NatNet server: replies, and where frames go."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from arena.mocap.natnet import codec as natnet
from arena.mocap.natnet import echo
from arena.wire.truth_page import Truth

from ..rig import NatNetRig, settings


def still() -> Truth:
    z = np.zeros((1, 3))
    return Truth(
        time_s=0.0,
        p_n=z + 1.0,
        q_nb=np.array([[1.0, 0, 0, 0]]),
        v_n=z,
        omega_b=z,
        accel_b=z,
        motors=np.zeros((1, 4)),
    )


def test_requests_are_answered_and_keepalives_are_not():
    rig = NatNetRig(settings())
    assert rig.server.reply(natnet.packet(natnet.KEEPALIVE), ("127.0.0.1", 9), 0.0) is None
    assert (
        natnet.message_of(rig.server.reply(natnet.packet(natnet.CONNECT), ("127.0.0.1", 9), 0.0))
        == natnet.SERVERINFO
    )
    assert (
        natnet.message_of(rig.server.reply(natnet.packet(natnet.REQUEST_MODELDEF), ("127.0.0.1", 9), 0.0))
        == natnet.MODELDEF
    )


CONNECT, KEEPALIVE, MODELS = (
    natnet.packet(m) for m in (natnet.CONNECT, natnet.KEEPALIVE, natnet.REQUEST_MODELDEF)
)
HERE, DATA = ("127.0.0.1", 4000), ("127.0.0.1", 1511)


def test_unicast_client_gets_frames_at_both_its_ports_after_the_handshake():
    rig = NatNetRig(settings(transport="unicast"))
    assert rig.server.destinations(0.0) == []
    rig.server.reply(CONNECT, HERE, 0.0)
    assert rig.server.destinations(0.1) == [DATA]
    rig.server.reply(MODELS, HERE, 0.2)
    assert rig.server.destinations(0.2) == [DATA, HERE]


def test_client_without_a_model_request_gets_frames_after_half_a_second():
    rig = NatNetRig(settings(transport="unicast"))
    rig.server.reply(CONNECT, HERE, 0.0)
    assert rig.server.destinations(0.6) == [DATA, HERE]


def test_client_that_stops_its_keepalives_is_dropped():
    rig = NatNetRig(settings(transport="unicast"))
    rig.server.reply(CONNECT, HERE, 0.0)
    assert rig.server.destinations(3600.0) == [DATA, HERE]
    rig.server.reply(KEEPALIVE, HERE, 3600.0)
    assert rig.server.destinations(3609.0) == [DATA, HERE]
    assert rig.server.destinations(3611.0) == []


def test_disconnect_removes_a_client_without_a_reply():
    rig = NatNetRig(settings(transport="unicast"))
    rig.server.reply(CONNECT, HERE, 0.0)
    assert rig.server.reply(natnet.packet(natnet.DISCONNECT), HERE, 1.0) is None
    assert rig.server.destinations(1.0) == []


def test_many_new_clients_do_not_displace_one_with_keepalives():
    rig = NatNetRig(settings(transport="unicast"))
    rig.server.reply(CONNECT, HERE, 0.0)
    rig.server.reply(KEEPALIVE, HERE, 0.5)
    for port in range(5000, 6000):
        rig.server.reply(CONNECT, ("127.0.0.1", port), 1.0)
    assert HERE in rig.server.destinations(2.0)


def test_frame_carries_its_exposure_and_transmit_times():
    frame = natnet.decode_frame(NatNetRig(settings()).packet(360, still()), (3, 1))
    assert (frame.exposure_ticks, frame.transmit_ticks) == (20_000_000, 20_100_000)
    late = natnet.decode_frame(NatNetRig(settings()).packet(360, still(), sent_s=2.5), (3, 1))
    assert late.transmit_ticks == 25_000_000


def test_number_of_clients_is_limited():
    rig = NatNetRig(settings(transport="unicast"))
    for port in range(1, 5000):
        rig.server.reply(natnet.packet(natnet.CONNECT), ("127.0.0.1", port), 0.0)
    assert len(rig.server.destinations(1.0)) <= 65


@given(st.binary(max_size=200))
def test_any_bytes_are_accepted_as_a_request(data):
    rig = NatNetRig(settings())
    rig.server.reply(data, ("127.0.0.1", 9), 0.0)


def test_echo_request_is_answered_with_the_time_of_the_last_frame():
    rig = NatNetRig(settings())
    rig.packet(180, still(), sent_s=1.25)
    reply = rig.server.reply(echo.encode_echo_request(77), ("127.0.0.1", 9), 0.0)
    assert echo.decode_echo_response(reply) == (77, round(1.25e7))
    assert rig.server.reply(natnet.packet(natnet.ECHO_REQUEST, b"x"), ("127.0.0.1", 9), 0.0) is None
    assert rig.server.counts["malformed"] == 1
