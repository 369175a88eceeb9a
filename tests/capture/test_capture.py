"""The receiver: handshake, names, NED, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.geometry import q_nb_from_q_wf, q_wf_from_q_nb, quat_from_euler, wxyz_from_xyzw, xyzw_from_wxyz
from arena.mocap.client.natnet import NatNetReceiver
from arena.mocap.client.pose import pose_ned
from arena.wire import natnet

INFO = natnet.encode_server_info(
    natnet.ServerInfo(
        name="x", app_version=(3, 1, 0, 0), version=(3, 1), clock_hz=1, data_port=1511, group=""
    )
)


def shaken(bodies=None) -> NatNetReceiver:
    receiver = NatNetReceiver(bodies)
    receiver.hear(INFO)
    receiver.hear(natnet.encode_models([(1, "uav1"), (2, "uav2")], (3, 1)))
    return receiver


def frame(*bodies: natnet.Body) -> bytes:
    return natnet.encode_frame(
        natnet.Frame(number=3, timestamp_s=1.0, exposure_ticks=0, bodies=bodies), (3, 1)
    )


def body(i=1, tracked=True, quat=(0.0, 0.0, 0.0, 1.0), position=(1.0, 2.0, 3.0)) -> natnet.Body:
    return natnet.Body(streaming_id=i, position=position, quat_xyzw=quat, tracked=tracked)


@given(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_the_plain_float_conversion_is_the_one_of_geometry(q):
    q = np.array(q) / np.linalg.norm(q)
    pose = pose_ned("b", (1.0, 2.0, 3.0), tuple(q))
    expected = q_nb_from_q_wf(wxyz_from_xyzw(q))
    assert np.allclose(pose.q_nb, expected, atol=1e-9) or np.allclose(pose.q_nb, -expected, atol=1e-9)
    assert pose.p_n == (2.0, 1.0, -3.0)


def test_a_generic_attitude_arrives_as_it_was_meant():
    rpy = np.radians([10.0, -20.0, 35.0])
    pose = pose_ned("b", (0.0, 0.0, 1.0), tuple(xyzw_from_wxyz(q_wf_from_q_nb(quat_from_euler(rpy)))))
    assert np.allclose(pose.q_nb, quat_from_euler(rpy))


def test_the_handshake_asks_for_the_server_then_for_its_models():
    receiver = NatNetReceiver(["uav1"])
    assert natnet.message_of(receiver.ask()) == natnet.CONNECT
    receiver.hear(INFO)
    assert natnet.message_of(receiver.ask()) == natnet.REQUEST_MODELDEF
    assert not receiver.known
    receiver.hear(natnet.encode_models([(5, "uav1")], (3, 1)))
    assert receiver.known


def test_only_wanted_bodies_come_through_and_each_under_its_name():
    assert [p.body for p in shaken(["uav2"]).hear(frame(body(1), body(2))).poses] == ["uav2"]
    assert [p.body for p in shaken().hear(frame(body(1), body(2))).poses] == ["uav1", "uav2"]


@pytest.mark.parametrize(
    "lost",
    [
        body(tracked=False),
        body(quat=(0.0, 0.0, 0.0, 0.0)),
        body(quat=(0.0, 0.0, 0.0, float("nan"))),
        body(position=(float("inf"), 0.0, 0.0)),
    ],
)
def test_an_untracked_or_impossible_body_is_no_pose(lost):
    found = shaken().hear(frame(lost))
    assert found.poses == ()
    assert found.untracked == ("uav1",)


def test_a_body_that_the_models_do_not_name_waits_for_new_models():
    receiver = shaken(["uav9"])
    assert not receiver.known
    assert receiver.hear(frame(body(9))) is None or receiver.hear(frame(body(9))).poses == ()


@given(st.binary(max_size=300))
def test_any_bytes_are_survived_and_counted(data):
    receiver = shaken()
    before = sum(receiver.counts.values())
    receiver.hear(data)
    assert sum(receiver.counts.values()) >= before
