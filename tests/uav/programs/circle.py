"""Fly two laps of a circle by one kind of setpoint, started together with the other vehicles. Arguments: setpoints."""

from __future__ import annotations

import sys

import numpy as np

from arena import UAV

RADIUS_M, SPEED_M_S, LAPS, RATE_HZ = 1.0, 0.6, 2, 50

with UAV.from_args() as uav:
    (setpoints,) = uav.args
    uav.start_offboard_mission()
    centre = uav.ekf.pos + np.array([0.0, 0.0, -1.5])
    uav.set_pos_yaw(centre + np.array([RADIUS_M, 0.0, 0.0]), 0.0, 6.0)
    began = uav.wait_for("start")
    print(f"start {began:.4f} now {uav.clock.now():.4f}", file=sys.stderr, flush=True)
    omega = SPEED_M_S / RADIUS_M
    while (t := uav.clock.now() - began) < LAPS * 2.0 * np.pi / omega:
        c, s = np.cos(omega * t), np.sin(omega * t)
        pos = centre + RADIUS_M * np.array([c, s, 0.0])
        vel = SPEED_M_S * np.array([-s, c, 0.0])
        acc = SPEED_M_S * omega * np.array([-c, -s, 0.0])
        uav.reference(p=pos, v=vel, yaw=0.0)
        if setpoints == "position":
            uav.set_pos_yaw(pos, 0.0, 1.0 / RATE_HZ)
        elif setpoints == "position+velocity":
            uav.set_pos_vel_yaw(pos, vel, 0.0, RATE_HZ)
        else:
            uav.set_pos_vel_yaw(pos, vel, 0.0, RATE_HZ, acc=acc)
    uav.auto_land()
