"""The NatNet receiver: handshake, body names, NED poses, and packets that it drops."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.geometry import q_nb_from_q_wf, q_wf_from_q_nb, quat_from_euler, wxyz_from_xyzw, xyzw_from_wxyz
from arena.mocap.client.pose import Echo, pose_ned
from arena.mocap.natnet import codec as natnet
from arena.mocap.natnet import echo
from arena.mocap.natnet.receiver import NatNetReceiver

INFO = natnet.encode_server_info(
    natnet.ServerInfo(
        name="x", app_version=(3, 1, 0, 0), version=(3, 1), clock_hz=1, data_port=1511, group=""
    )
)


def connected_receiver(bodies=None) -> NatNetReceiver:
    receiver = NatNetReceiver(bodies)
    receiver.receive(INFO)
    receiver.receive(natnet.encode_models([(1, "uav1"), (2, "uav2")], (3, 1)))
    return receiver


def frame(*bodies: natnet.Body, number: int = 3) -> bytes:
    return natnet.encode_frame(
        natnet.Frame(number=number, timestamp_s=1.0, exposure_ticks=0, bodies=bodies), (3, 1)
    )


def body(i=1, tracked=True, quat=(0.0, 0.0, 0.0, 1.0), position=(1.0, 2.0, 3.0)) -> natnet.Body:
    return natnet.Body(streaming_id=i, position=position, quat_xyzw=quat, tracked=tracked)


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_plain_float_conversion_equals_that_of_geometry(q):
    q = np.array(q) / np.linalg.norm(q)
    pose = pose_ned("b", (1.0, 2.0, 3.0), tuple(q))
    expected = q_nb_from_q_wf(wxyz_from_xyzw(q))
    assert np.allclose(pose.q_nb, expected, atol=1e-9) or np.allclose(pose.q_nb, -expected, atol=1e-9)
    assert pose.p_n == (2.0, 1.0, -3.0)


def test_generic_attitude_is_converted_exactly():
    rpy = np.radians([10.0, -20.0, 35.0])
    pose = pose_ned("b", (0.0, 0.0, 1.0), tuple(xyzw_from_wxyz(q_wf_from_q_nb(quat_from_euler(rpy)))))
    assert np.allclose(pose.q_nb, quat_from_euler(rpy))


def test_handshake_requests_server_info_then_models():
    receiver = NatNetReceiver(["uav1"])
    assert natnet.message_of(receiver.next_request()) == natnet.CONNECT
    receiver.receive(INFO)
    assert natnet.message_of(receiver.next_request()) == natnet.REQUEST_MODELDEF
    assert not receiver.is_connected
    receiver.receive(natnet.encode_models([(5, "uav1")], (3, 1)))
    assert receiver.is_connected


def test_only_wanted_bodies_give_poses():
    assert [p.body for p in connected_receiver(["uav2"]).receive(frame(body(1), body(2))).poses] == ["uav2"]
    assert [p.body for p in connected_receiver().receive(frame(body(1), body(2))).poses] == ["uav1", "uav2"]


def test_body_that_is_added_later_gives_poses_and_the_others_continue():
    receiver = connected_receiver(["uav1"])
    receiver.add_body("uav2")
    assert not receiver.is_connected and receiver.next_request() == natnet.packet(natnet.REQUEST_MODELDEF)
    assert [p.body for p in receiver.receive(frame(body(1), body(2))).poses] == ["uav1"]
    receiver.receive(natnet.encode_models([(1, "uav1"), (2, "uav2")], (3, 1)))
    assert receiver.is_connected
    assert [p.body for p in receiver.receive(frame(body(1), body(2), number=9)).poses] == ["uav1", "uav2"]


@pytest.mark.parametrize(
    "lost",
    [
        body(tracked=False),
        body(quat=(0.0, 0.0, 0.0, 0.0)),
        body(quat=(0.0, 0.0, 0.0, float("nan"))),
        body(position=(float("inf"), 0.0, 0.0)),
    ],
)
def test_untracked_or_impossible_body_gives_no_pose(lost):
    found = connected_receiver().receive(frame(lost))
    assert found.poses == ()
    assert found.untracked == ("uav1",)


def test_body_without_a_model_gives_no_pose():
    receiver = connected_receiver(["uav9"])
    assert not receiver.is_connected
    assert receiver.receive(frame(body(9))) is None or receiver.receive(frame(body(9))).poses == ()


@given(st.binary(max_size=300))
def test_any_bytes_are_accepted(data):
    receiver = connected_receiver()
    before = sum(receiver.counts.values())
    receiver.receive(data)
    assert sum(receiver.counts.values()) >= before


def ticked(number: int) -> bytes:
    return natnet.encode_frame(
        natnet.Frame(number=number, timestamp_s=1.0, exposure_ticks=7, transmit_ticks=9, bodies=(body(),)),
        (3, 1),
    )


def test_frames_carry_the_last_comparison_of_the_clocks():
    receiver = connected_receiver()
    first = receiver.receive(ticked(1))
    assert (first.time_s, first.sent_s, first.echo) == (7.0, 9.0, None)
    request = echo.decode_echo_request(receiver.echo_request(100.0))
    receiver.receive(echo.encode_echo_response(request + 1, 50), 100.2)
    assert receiver.receive(ticked(2)).echo is None, "an answer to no request"
    receiver.receive(echo.encode_echo_response(request, 50), 100.5)
    assert receiver.receive(ticked(3)).echo == Echo(100.0, 100.5, 50.0)
    receiver.receive(echo.encode_echo_response(request, 51), 100.6)
    assert receiver.receive(ticked(4)).echo == Echo(100.0, 100.5, 50.0), "a repeated answer"


def test_unanswered_echo_requests_are_forgotten():
    receiver = connected_receiver()
    for i in range(1000):
        receiver.echo_request(float(i))
    assert len(receiver._echoes_sent) < 10


def test_a_definition_changes_with_the_markers_of_its_body():
    def definition(*markers, streaming_id=5):
        receiver = NatNetReceiver(["uav1"])
        assert receiver.definition("uav1") == ""
        receiver.receive(INFO)
        receiver.receive(natnet.encode_models([(streaming_id, "uav1"), (9, "wand")], (3, 1), markers))
        assert receiver.definition("wand") == ""
        return receiver.definition("uav1")

    assert definition((0.1, 0.0, 0.0)).startswith("markers ")
    assert definition((0.1, 0.0, 0.0)) == definition((0.1, 0.0, 0.0)) != definition((0.1, 0.0, 0.01))
    assert definition() == "name uav1, id 5"
    assert definition(streaming_id=6) != definition()
