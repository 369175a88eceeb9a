"""Navigation: an estimator from distances to beacons, beside the flight or in the control loop.

The vehicle flies the figure of the thesis with a position controller of its own. With the argument `closed`, position and velocity of
the controller come from the estimator, else from the autopilot. At the end the program prints the errors of its estimate.
"""

import numpy as np
from range_filter import RangeFilter

from arena import UAV
from arena.controllers import Gains, PositionPid
from arena.geometry import quat_rotate
from arena.trajectories import Reference

FREQ_HZ, FLY_S = 50, 80.0
KP, KD, KI = (
    (5.5, 5.5, 4.0),
    (5.5, 5.5, 4.0),
    (0.15, 0.15, 0.5),
)  # [N/m], [N s/m], [N/(m s)]: those of the thesis
SIZE = np.array([2.6, 1.6, -0.6])  # [m]
RATE = np.pi * np.array(
    [1 / 10, 2 / 30, 2 / 45]
)  # [rad/s]: a third of the thesis's, which needs 2.5 m/s in this room
PHASE = np.array([np.pi / 6, 0.0, np.pi / 9])
CENTRE = np.array([0.0, 0.0, -1.2])
GRAVITY = np.array([0.0, 0.0, 9.80665])


def figure(t):
    """Return the reference at the time t [s]."""
    a = RATE * t + PHASE
    return Reference(
        pos=CENTRE + SIZE * np.cos(a), vel=-RATE * SIZE * np.sin(a), acc=-(RATE**2) * SIZE * np.cos(a)
    )


class Navigator:
    """Feeds the estimator with the sensors of the vehicle, each measurement once."""

    def __init__(self, uav, guess):
        self.uav, self.filter = uav, RangeFilter(guess, 0.3)
        self.time, self.stamps, self.used = uav.clock.now(), {}, 0

    def update(self):
        now, seen = self.uav.clock.now(), self.uav.snapshot()
        acc = quat_rotate(seen.ekf.att_q, seen.sen.imu.acc_body) + GRAVITY
        self.filter.predict(acc, now - self.time)
        self.time = now
        for name, beacon in seen.sen.beacons.items():
            measured = beacon.measurement
            if self.stamps.get(name) != measured.time_s:
                self.stamps[name] = measured.time_s
                self.filter.correct(beacon.pos, measured.range_m, measured.range_noise_m)
                self.used += 1


def main(uav, closed):
    mass = uav.info.mass
    pid = PositionPid(
        mass,
        Gains(p=tuple(k / mass for k in KP), d=tuple(k / mass for k in KD), i=tuple(k / mass for k in KI)),
    )
    uav.start_offboard_mission()
    uav.set_pos_yaw(figure(0.0).pos, 0.0, 10.0)
    navigator = Navigator(uav, figure(0.0).pos + [0.2, -0.2, 0.1])  # a wrong first guess
    errors, began = [], uav.clock.now()
    while (t := uav.clock.now() - began) < FLY_S:
        navigator.update()
        wanted, ekf = figure(t), uav.snapshot().ekf
        uav.reference(wanted.pos, wanted.vel, 0.0)
        # the first seconds correct the wrong guess
        own = closed and t > 5.0
        pos, vel = (navigator.filter.pos, navigator.filter.vel) if own else (ekf.pos, ekf.vel)
        found = pid.update(wanted, pos, vel, uav.clock.now())
        uav.set_att_thrust(found.q_nb, "quaternion", found.thrust_n, FREQ_HZ)
        if t > 10.0:
            errors.append(np.concatenate([navigator.filter.pos - ekf.pos, navigator.filter.vel - ekf.vel]))
    error = np.array(errors)
    print(f"measurements: {navigator.used}")
    print(f"position_error_m: {np.sqrt(np.mean(np.sum(error[:, :3] ** 2, axis=1))):.4f}")
    print(f"velocity_error_m_s: {np.sqrt(np.mean(np.sum(error[:, 3:] ** 2, axis=1))):.4f}")
    print(f"largest_position_error_m: {np.linalg.norm(error[:, :3], axis=1).max():.4f}", flush=True)
    uav.set_pos_yaw([0.0, 0.0, -0.8], 0.0, 8.0)
    uav.auto_land()


with UAV.from_args() as vehicle:
    main(vehicle, "closed" in vehicle.args)
