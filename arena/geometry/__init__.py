"""Conversions between coordinate frames, and between representations of rotations.

Pure numpy functions on arrays of any leading shape.

| letter | frame       | axes                                   |
|--------|-------------|----------------------------------------|
| n      | local NED   | north, east, down                      |
| b      | body FRD    | forward, right, down                   |
| w      | arena world | x east, y north, z up (z-up capture)   |
| f      | body FLU    | forward, left, up                      |

`q_nb` is a unit Hamilton quaternion, wxyz, with v_n = q_nb * v_b * conj(q_nb); read it as "n from b". In a
product the inner letters cancel: q_nf = q_nw * q_wf. Every array is float64; vectors (..., 3), quaternions
(..., 4).
"""

from arena.geometry.frames import (
    EARTH_M,
    frd_from_flu,
    globe_from_local,
    local_from_globe,
    ned_from_world,
    q_nb_from_q_wf,
    q_wf_from_q_nb,
    turn_horizontal,
    world_from_ned,
    wxyz_from_xyzw,
    xyzw_from_wxyz,
)
from arena.geometry.quaternion import (
    Array,
    euler_from_matrix,
    euler_from_quat,
    matrix_from_quat,
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
    wrap_pi,
    yaw_from_quat,
)

__all__ = [
    "EARTH_M",
    "Array",
    "euler_from_matrix",
    "euler_from_quat",
    "frd_from_flu",
    "globe_from_local",
    "local_from_globe",
    "matrix_from_quat",
    "ned_from_world",
    "q_nb_from_q_wf",
    "q_wf_from_q_nb",
    "quat_between",
    "quat_conj",
    "quat_exp",
    "quat_from_euler",
    "quat_from_matrix",
    "quat_log",
    "quat_multiply",
    "quat_normalize",
    "quat_rotate",
    "quat_slerp",
    "turn_horizontal",
    "world_from_ned",
    "wrap_pi",
    "wxyz_from_xyzw",
    "xyzw_from_wxyz",
    "yaw_from_quat",
]
