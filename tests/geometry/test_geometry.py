"""Rotations satisfy the group axioms; frames follow the package's conventions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from arena.geometry import (
    euler_from_quat,
    frd_from_flu,
    globe_from_local,
    local_from_globe,
    matrix_from_quat,
    ned_from_world,
    q_nb_from_q_wf,
    q_wf_from_q_nb,
    quat_between,
    quat_conj,
    quat_exp,
    quat_from_euler,
    quat_from_matrix,
    quat_log,
    quat_multiply,
    quat_normalize,
    quat_rotate,
    quat_slerp,
    world_from_ned,
    wrap_pi,
    wxyz_from_xyzw,
    xyzw_from_wxyz,
    yaw_from_quat,
)

GENERIC_RPY = np.radians([10.0, -20.0, 35.0])
# Angles from far below what a float can tell from no rotation, up to nearly half a turn.
angle = st.sampled_from([0.0, 1e-12, 1e-8, 1e-6, 1e-3]) | st.floats(0, 3.1)
axis = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
rotation = st.builds(lambda a, u: quat_exp(a * np.array(u) / np.linalg.norm(u)), angle, axis)
vector = st.tuples(*[st.floats(-100, 100)] * 3).map(np.array)


def same(a, b, atol=1e-9):
    """Return whether two quaternions are the same rotation: q and -q are."""
    return np.allclose(a, b, atol=atol) or np.allclose(a, -np.asarray(b), atol=atol)


@given(rotation, rotation, rotation)
def test_products_associate_and_have_inverses(a, b, c):
    assert np.allclose(quat_multiply(quat_multiply(a, b), c), quat_multiply(a, quat_multiply(b, c)))
    assert same(quat_multiply(a, quat_conj(a)), [1, 0, 0, 0])


@given(rotation, rotation)
def test_quat_between_is_conjugate_times_second(a, b):
    assert np.allclose(quat_between(a, b), quat_multiply(quat_conj(a), b), atol=1e-15)


@given(rotation, rotation, vector)
def test_rotation_by_a_product_is_two_rotations(a, b, v):
    assert np.allclose(quat_rotate(quat_multiply(a, b), v), quat_rotate(a, quat_rotate(b, v)), atol=1e-7)


@given(rotation, vector)
def test_matrix_and_quaternion_rotate_the_same(q, v):
    assert np.allclose(matrix_from_quat(q) @ v, quat_rotate(q, v), atol=1e-7)
    assert same(quat_from_matrix(matrix_from_quat(q)), q, atol=1e-7)


@given(rotation)
def test_log_and_exp_are_inverses_also_near_identity(q):
    assert same(quat_exp(quat_log(q)), q, atol=1e-8)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1))
def test_euler_angles_round_trip(roll, pitch, yaw):
    q = quat_from_euler([roll, pitch, yaw])
    assert np.allclose(euler_from_quat(q), [roll, pitch, yaw], atol=1e-6)
    assert np.isclose(yaw_from_quat(q), yaw, atol=1e-6)


@given(rotation, rotation, st.floats(0, 1))
def test_slerp_interpolates_at_constant_rate(a, b, f):
    whole, part = (
        quat_log(quat_multiply(quat_conj(a), b)),
        quat_log(quat_multiply(quat_conj(a), quat_slerp(a, b, f))),
    )
    assert np.allclose(part, f * whole, atol=1e-6)


def test_q_nb_rotates_body_vectors_to_ned():
    """Nose east by yaw 90 degrees; nose up by a positive pitch; right wing down by a positive roll."""
    assert np.allclose(quat_rotate(quat_from_euler([0, 0, np.pi / 2]), [1, 0, 0]), [0, 1, 0])
    assert quat_rotate(quat_from_euler([0, 0.3, 0]), [1, 0, 0])[2] < 0
    assert quat_rotate(quat_from_euler([0.3, 0, 0]), [0, 1, 0])[2] > 0


def test_world_axes_convert_to_ned():
    assert np.allclose(ned_from_world([1.0, 2.0, 3.0]), [2.0, 1.0, -3.0])
    assert np.allclose(world_from_ned(ned_from_world([1.0, 2.0, 3.0])), [1.0, 2.0, 3.0])


@given(rotation, vector)
def test_both_ways_around_the_frames_agree(q_wf, v_f):
    by_world = ned_from_world(quat_rotate(q_wf, v_f))
    by_body = quat_rotate(q_nb_from_q_wf(q_wf), frd_from_flu(v_f))
    assert np.allclose(by_world, by_body, atol=1e-7)
    assert same(q_wf_from_q_nb(q_nb_from_q_wf(q_wf)), q_wf)


def test_a_generic_attitude_converts_from_mocap_axes():
    """The forward axis of roll 10, pitch -20, yaw 35 degrees, calculated by hand: heading 35 from north, nose down."""
    q_wf = q_wf_from_q_nb(quat_from_euler(GENERIC_RPY))
    east, north, up = quat_rotate(q_wf, [1.0, 0.0, 0.0])
    assert np.isclose(np.degrees(np.arctan2(east, north)), 35.0)
    assert np.isclose(up, np.sin(np.radians(-20.0)))


def test_scalar_first_and_last_orders_convert():
    assert np.allclose(wxyz_from_xyzw([1, 2, 3, 4]), [4, 1, 2, 3])
    assert np.allclose(xyzw_from_wxyz(wxyz_from_xyzw([1, 2, 3, 4])), [1, 2, 3, 4])


@given(st.floats(-1e3, 1e3))
def test_wrap_pi_keeps_the_direction_within_one_turn(a):
    w = wrap_pi(a)
    assert -np.pi <= w < np.pi + 1e-12
    assert np.isclose(np.cos(w), np.cos(a), atol=1e-6)
    assert np.isclose(np.sin(w), np.sin(a), atol=1e-6)


def test_a_zero_or_broken_quaternion_is_refused():
    for q in ([0, 0, 0, 0], [np.nan, 0, 0, 1]):
        try:
            quat_normalize(q)
        except ValueError:
            continue
        raise AssertionError(f"{q} was taken for a rotation")


@given(lat0=st.floats(-80, 80), lon0=st.floats(-180, 180), n=st.floats(-500, 500), e=st.floats(-500, 500))
def test_global_position_round_trip(lat0: float, lon0: float, n: float, e: float) -> None:
    assert local_from_globe(lat0, lon0, *globe_from_local(lat0, lon0, n, e)) == pytest.approx(
        (n, e), abs=1e-6
    )


def test_a_degree_is_111_km_and_east_shrinks_with_latitude() -> None:
    north, east = local_from_globe(60.0, 179.5, 61.0, -179.5)  # across the date line
    assert north == pytest.approx(111_195, abs=1) and east == pytest.approx(111_195 / 2, abs=1)
