"""The formation of the thesis: the leader's ellipse, and three followers on a circle around the leader, at 0.5 rad/s.

All positions, velocities and accelerations are NED [m, m/s, m/s2] (3,).
"""

import numpy as np

FREQ_HZ = 50
RATE = 0.5  # [rad/s]
HEIGHT_M, NORTH_M, EAST_M, RADIUS_M = 1.25, 0.8, 0.3, 1.5
CLIMB_S, STAND_S, TURN_S = (
    5.0,
    10.0,
    35.0,
)  # to the start, in the standing formation, in the turning formation


def leader(t):
    """Return position, velocity and acceleration of the leader. t: time since the formation turns [s]; it stands before."""
    turning, t = t > 0.0, max(t, 0.0)
    cos, sin = np.cos(RATE * t), np.sin(RATE * t)
    pos = np.array([NORTH_M * cos, -EAST_M * sin, -HEIGHT_M])
    vel = RATE * np.array([-NORTH_M * sin, -EAST_M * cos, 0.0])
    acc = RATE**2 * np.array([-NORTH_M * cos, EAST_M * sin, 0.0])
    return pos, turning * vel, turning * acc


def place(angle, t):
    """Return position, velocity and acceleration of a follower relative to the leader. angle: at the start, from east [rad]."""
    turning, a = t > 0.0, angle + RATE * max(t, 0.0)
    out, along = np.array([np.sin(a), np.cos(a), 0.0]), np.array([np.cos(a), -np.sin(a), 0.0])
    return (
        RADIUS_M * out,
        turning * RATE * RADIUS_M * along,
        turning * -(RATE**2) * RADIUS_M * out,
    )
