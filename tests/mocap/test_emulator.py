"""The emulator's core: noise, occlusion, freezing, clients."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from arena.mocap.emulator.core import Emulator
from arena.wire import natnet
from arena.wire.truth_page import Truth


def settings(**changes):
    return {
        "version": "3.1",
        "rate_hz": 180,
        "latency_ms": 10,
        "bodies": [{"name": "uav1", "streaming_id": 4, "index": 0}],
        "noise": {"position_m": 0.002, "rotation_deg": 0.5},
        "seed": 1,
        "transport": "multicast",
        "data_port": 1511,
        "group": "239.255.42.99",
        **changes,
    }


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


def body(packet: bytes) -> natnet.Body:
    return natnet.decode_frame(packet, (3, 1)).bodies[0]


def test_noise_has_its_size_does_not_accumulate_and_leaves_the_truth_alone():
    emulator, truth = Emulator(settings()), still()
    found = np.array([body(emulator.frame(n, truth)).position for n in range(4000)])
    assert np.allclose(found.std(0), 0.002, rtol=0.1)
    assert np.allclose(found[-500:].mean(0), [1.0, 1.0, -1.0], atol=0.0005)
    assert np.array_equal(truth.p_n, still().p_n)
    assert np.array_equal(truth.q_nb, still().q_nb)


def test_the_same_seed_gives_the_same_frames():
    a, b = Emulator(settings()), Emulator(settings())
    assert [a.frame(n, still()) for n in range(5)] == [b.frame(n, still()) for n in range(5)]
    assert Emulator(settings(seed=2)).frame(0, still()) != Emulator(settings()).frame(0, still())


def test_an_occluded_body_is_still_sent_at_its_last_place_with_its_bit_cleared():
    emulator = Emulator(settings())
    seen = body(emulator.frame(0, still()))
    emulator.occlude("uav1", True)
    lost = body(emulator.frame(1, still()))
    assert lost.position == seen.position
    assert seen.tracked
    assert not lost.tracked
    emulator.occlude("uav1", False)
    assert body(emulator.frame(2, still())).tracked


def test_a_frozen_body_keeps_its_pose_and_its_bit():
    emulator = Emulator(settings())
    seen = body(emulator.frame(0, still()))
    emulator.freeze("uav1", True)
    stuck = body(emulator.frame(1, still()))
    assert (stuck.position, stuck.tracked) == (seen.position, True)


def test_keepalives_are_never_answered_and_requests_are():
    emulator = Emulator(settings())
    assert emulator.hear(natnet.packet(natnet.KEEPALIVE), ("127.0.0.1", 9), 0.0) is None
    assert (
        natnet.message_of(emulator.hear(natnet.packet(natnet.CONNECT), ("127.0.0.1", 9), 0.0))
        == natnet.SERVERINFO
    )
    assert (
        natnet.message_of(emulator.hear(natnet.packet(natnet.REQUEST_MODELDEF), ("127.0.0.1", 9), 0.0))
        == natnet.MODELDEF
    )


CONNECT, KEEPALIVE, MODELS = (
    natnet.packet(m) for m in (natnet.CONNECT, natnet.KEEPALIVE, natnet.REQUEST_MODELDEF)
)
HERE, DATA = ("127.0.0.1", 4000), ("127.0.0.1", 1511)


def test_a_unicast_client_gets_frames_at_both_its_ports_but_none_between_its_questions():
    emulator = Emulator(settings(transport="unicast"))
    assert emulator.destinations(0.0) == []
    emulator.hear(CONNECT, HERE, 0.0)
    assert emulator.destinations(0.1) == [DATA]
    emulator.hear(MODELS, HERE, 0.2)
    assert emulator.destinations(0.2) == [DATA, HERE]


def test_a_client_that_asks_for_no_models_gets_its_frames_soon_after():
    emulator = Emulator(settings(transport="unicast"))
    emulator.hear(CONNECT, HERE, 0.0)
    assert emulator.destinations(0.6) == [DATA, HERE]


def test_a_client_that_never_sends_keepalives_is_served_on_and_one_that_stops_is_forgotten():
    emulator = Emulator(settings(transport="unicast"))
    emulator.hear(CONNECT, HERE, 0.0)
    assert emulator.destinations(3600.0) == [DATA, HERE]
    emulator.hear(KEEPALIVE, HERE, 3600.0)
    assert emulator.destinations(3609.0) == [DATA, HERE]
    assert emulator.destinations(3611.0) == []


def test_a_client_that_takes_its_leave_is_gone_at_once_without_an_answer():
    emulator = Emulator(settings(transport="unicast"))
    emulator.hear(CONNECT, HERE, 0.0)
    assert emulator.hear(natnet.packet(natnet.DISCONNECT), HERE, 1.0) is None
    assert emulator.destinations(1.0) == []


def test_a_crowd_of_strangers_does_not_drive_out_who_keeps_alive():
    emulator = Emulator(settings(transport="unicast"))
    emulator.hear(CONNECT, HERE, 0.0)
    emulator.hear(KEEPALIVE, HERE, 0.5)
    for port in range(5000, 6000):
        emulator.hear(CONNECT, ("127.0.0.1", port), 1.0)
    assert HERE in emulator.destinations(2.0)


def test_a_frozen_body_that_is_occluded_loses_its_bit():
    emulator = Emulator(settings())
    emulator.freeze("uav1", True)
    seen = body(emulator.frame(0, still()))
    assert body(emulator.frame(1, still())) == seen
    emulator.occlude("uav1", True)
    lost = body(emulator.frame(2, still()))
    assert (lost.position, lost.tracked) == (seen.position, False)


def test_a_body_back_from_occlusion_is_where_the_truth_is():
    emulator = Emulator(settings())
    first = body(emulator.frame(0, still()))
    emulator.occlude("uav1", True)
    emulator.frame(1, still())
    emulator.occlude("uav1", False)
    again = body(emulator.frame(2, still()))
    assert again.tracked
    assert again.position != first.position


def test_a_frame_says_when_it_was_exposed_and_when_it_left():
    frame = natnet.decode_frame(Emulator(settings()).frame(360, still()), (3, 1))
    assert (frame.exposure_ticks, frame.transmit_ticks) == (20_000_000, 20_100_000)
    late = natnet.decode_frame(Emulator(settings()).frame(360, still(), sent=2.5), (3, 1))
    assert late.transmit_ticks == 25_000_000


def test_a_crowd_of_clients_is_bounded():
    emulator = Emulator(settings(transport="unicast"))
    for port in range(1, 5000):
        emulator.hear(natnet.packet(natnet.CONNECT), ("127.0.0.1", port), 0.0)
    assert len(emulator.destinations(1.0)) <= 65


@given(st.binary(max_size=200))
def test_any_request_is_survived(data):
    emulator = Emulator(settings())
    emulator.hear(data, ("127.0.0.1", 9), 0.0)
