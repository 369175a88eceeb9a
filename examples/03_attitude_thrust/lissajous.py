"""Attitude and thrust: the position controller is the program's own, and draws a figure of eight.

The autopilot keeps the attitude, 250 times a second; where to tilt and how hard to push is decided here, 50 times a
second, by a spring and a damper around the moving place (feed-forward included, so that the spring has little to do).
Thrust is in newtons: the profile's thrust curve turns it into what the autopilot understands. It leans by more than 20
degrees, at up to 2 m/s.
"""

from math import asin, atan2, cos, pi, sin

import numpy as np

from arena import UAV

FREQ_HZ = 50
SPRING, DAMPER = 3.0, 2.8  # [1/s2], [1/s]: a little under critical damping
GRAVITY = np.array([0.0, 0.0, 9.80665])  # [m/s2] north, east, down
NORTH_M, EAST_M, HEIGHT_M, LAP_S, LAPS = 1.2, 0.8, 1.2, 6.0, 4


def eight(t):
    """Place, velocity and acceleration [m, m/s, m/s2] north, east, down (3,) at t [s], from rest."""
    w = 2 * pi / LAP_S
    # the figure grows in the first lap, so that it starts from rest
    grow, rate, curve = ramp(t)
    size = np.array([NORTH_M, EAST_M, 0.0])
    shape = np.array([sin(w * t), sin(2 * w * t), 0.0])
    slope = np.array([w * cos(w * t), 2 * w * cos(2 * w * t), 0.0])
    bend = np.array([-w * w * sin(w * t), -4 * w * w * sin(2 * w * t), 0.0])
    return (
        size * grow * shape,
        size * (rate * shape + grow * slope),
        size * (curve * shape + 2 * rate * slope + grow * bend),
    )


def ramp(t):
    """From 0 to 1 in the first lap, and its first two derivatives: 3 s^2 - 2 s^3."""
    s = min(t / LAP_S, 1.0)
    d = 1 / LAP_S if s < 1.0 else 0.0
    return 3 * s**2 - 2 * s**3, (6 * s - 6 * s**2) * d, (6 - 12 * s) * d * d


def attitude_and_thrust(accel, mass):
    """Where to tilt, with the nose north, and how hard to push [N], for this acceleration [m/s2] north, east, down (3,)."""
    push = accel - GRAVITY  # what the rotors must give, per kilogram
    size = np.linalg.norm(push)
    return [asin(push[1] / size), atan2(-push[0], -push[2]), 0.0], mass * size


with UAV.from_args() as uav:
    uav.start_offboard_mission()
    centre = uav.ekf.pos + np.array([0.0, 0.0, -HEIGHT_M])
    uav.set_pos_yaw(centre, 0.0, 5.0)
    began = uav.clock.now()
    while (t := uav.clock.now() - began) < LAPS * LAP_S:
        place, velocity, accel = eight(t)
        now = uav.snapshot()  # position and velocity of the same instant
        pull = SPRING * (centre + place - now.ekf.pos) + DAMPER * (velocity - now.ekf.vel)
        tilt, thrust = attitude_and_thrust(accel + pull, uav.info.mass)
        uav.set_att_thrust(tilt, "euler", thrust, FREQ_HZ)
    uav.set_pos_yaw(centre, 0.0, 9.0)
    uav.auto_land()
