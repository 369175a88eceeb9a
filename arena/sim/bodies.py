"""Rigid bodies of a fleet. Vectors are NED and FRD, quaternions wxyz.

The kernel `free_flight` moves a vehicle that is away from floor, walls, ceiling, obstacles and other vehicles. Pybullet (`PybulletRoom`)
moves the vehicles near an obstacle. Before each sensor period the kernel `clearance` decides this for each vehicle. A vehicle
that changes from one to the other keeps its position, attitude and velocities. While all vehicles in pybullet stand still
(`Standstill`), it is not called.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from arena.geometry import (
    q_wf_from_q_nb,
    quat_rotate,
    world_from_ned,
    xyzw_from_wxyz,
)
from arena.kernels.arrays import array
from arena.kernels.clearance import Clearance
from arena.kernels.flight_period import FlightPeriod
from arena.kernels.free_flight import FreeFlight
from arena.kernels.standstill import Standstill
from arena.obstacles import Obstacle
from arena.sim.pybullet_room import Contacts, Motion, PybulletRoom
from arena.sim.vehicle_arrays import Fleet
from arena.vehicle_models import Dynamics

Array = NDArray[np.float64]

_FLU_FROM_FRD = np.array([1.0, -1.0, -1.0])


class Bodies:
    """Rigid bodies of a fleet in a room.

    fleet: the vehicles' bodies and their start positions
    size_m: size of the room: north, east, height [m]
    ceiling: False for a room that is open to the sky
    obstacles: fixed bodies in the room
    step_s: physics step [s]
    period_s: sensor period [s], the time between two calls of `begin`
    gui: True opens pybullet's window; all vehicles then stay in pybullet

    These arrays are valid after construction and after each `step`, which changes them:

    p_n: position of the body origin [m] [NED] (V, 3)
    q_nb: attitude [-] wxyz (V, 4); r_nb: its rotation matrix (V, 3, 3)
    v_n: velocity [m/s] [NED] (V, 3)
    omega_b: angular velocity [rad/s] [FRD] (V, 3)
    air_b: velocity relative to the air [m/s] [FRD] (V, 3)
    height: height of the body origin above the floor [m] (V,)
    accel_b: sum of the specific forces of all steps since `begin`, contact forces included [m/s2] [FRD] (V, 3)
    mean_accel_b: mean specific force of the last period, computed by `finish` [m/s2] [FRD] (V, 3)
    in_pybullet: rows of the vehicles that pybullet moves
    """

    def __init__(
        self,
        fleet: Fleet,
        *,
        size_m: Sequence[float],
        step_s: float,
        period_s: float,
        ceiling: bool = True,
        obstacles: Sequence[Obstacle] = (),
        gui: bool = False,
    ) -> None:
        self._room = PybulletRoom(
            fleet, size_m=size_m, step_s=step_s, ceiling=ceiling, obstacles=obstacles, gui=gui
        )
        self._free = np.zeros(fleet.size, bool)
        self._law = law = FreeFlight(self._free, step_s)
        array(law.mass)[:], array(law.inertia)[:] = fleet.mass, fleet.inertia
        self._state = Motion(
            place=array(law.place_w), quat=array(law.quat), speed=array(law.speed_w), rate=array(law.rate_w)
        )
        self._standstill: Standstill | None = None  # made by `free_flight`
        self._standing: Contacts | None = None  # contacts during a standstill
        self._period_s = period_s
        self._wind_n, self._force_b, self._torque_b = (
            array(law.wind_n),
            array(law.force_b),
            array(law.torque_b),
        )
        self.p_n, self.v_n, self.q_nb = array(law.p_n), array(law.v_n), array(law.q_nb)
        self.r_nb, self.omega_b, self.accel_b = array(law.r_nb), array(law.omega_b), array(law.accel_b)
        self.mean_accel_b = array(law.mean_accel_b)
        self.air_b, self.height = array(law.air_b), array(law.height)
        top = np.maximum(fleet.origin_height, fleet.height - fleet.origin_height)
        self._clearance = Clearance(
            self._free,
            law.place_w,
            law.speed_w,
            np.hypot(fleet.radius, top),
            self._room.boxes,
            period_s,
        )
        self._only_pybullet = gui
        self.in_pybullet: list[int] = []
        for i in range(fleet.size):
            self._set_motion(i, fleet.start_p_n[i], fleet.start_q_nb[i])
        self._set_in_pybullet(list(range(fleet.size)))

    def begin(self, wind_n: Array) -> None:
        """Begin a sensor period: select the vehicles near an obstacle. pybullet moves these vehicles.

        The compiled function `free_flight` moves all other vehicles.

        The sum of specific forces, `accel_b`, begins again at zero.

        wind_n: motion of the air at each vehicle in this period [m/s] [NED] (V, 3)
        """
        if not self._only_pybullet and self._clearance.check():
            near = (~self._free).nonzero()[0].tolist()
            if near != self.in_pybullet:
                self._set_in_pybullet(near)
        self._wind_n[...] = wind_n
        self._law.begin()

    def needs_pybullet(self) -> bool:
        """Return whether pybullet must compute this sensor period: a vehicle is near an obstacle, and there is no standstill.

        Call it once, after `begin`.
        """
        if not self.in_pybullet:
            return False
        if self._standstill is not None and not self._only_pybullet and self._standstill.check():
            self._standing = self._standing or self._room.contacts()
            return False
        self._standing = None
        return True

    def step(self, force_b: Array, torque_b: Array) -> None:
        """Make one physics step of all bodies.

        force_b: force at the centre of mass [N] [FRD] (V, 3)
        torque_b: torque about the centre of mass [N m] [FRD] (V, 3)

        Raises RunError if pybullet has ended.
        """
        if near := self.in_pybullet:
            rows, state = self._rows, self._state
            moved = self._room.step(near, force_b[rows] * _FLU_FROM_FRD, torque_b[rows] * _FLU_FROM_FRD)
            state.place[rows], state.quat[rows] = moved.place, moved.quat
            state.speed[rows], state.rate[rows] = moved.speed, moved.rate
        self._force_b[...], self._torque_b[...] = force_b, torque_b
        self._law.step()
        self._law.finish()

    def finish(self, steps: int) -> None:
        """End a sensor period: compute `mean_accel_b`. steps: number of steps since `begin`"""
        self._law.average(steps)

    def free_flight(self, dynamics: Dynamics) -> FlightPeriod:
        """Return the compiled function that moves all bodies for one sensor period, without pybullet.

        It replaces `step` while `needs_pybullet` returns False.
        """
        self._standstill = Standstill(dynamics.law, self._law, self._period_s)
        return FlightPeriod(dynamics.law, self._law)

    def contacts(self) -> Contacts:
        """Return a mask of the vehicles that touched something in the last step (V,).

        Something is the floor, a wall, the ceiling or another vehicle.
        """
        return self._standing or self._room.contacts()

    def place(
        self, index: int, *, p_n: Array, q_nb: Array, v_n: Array | None = None, omega_b: Array | None = None
    ) -> None:
        """Set position, attitude and velocities of one vehicle, for tests and experiments.

        p_n: position [m] [NED] (3,)
        q_nb: attitude [-] wxyz (4,)
        v_n: velocity [m/s] [NED] (3,), None for zero
        omega_b: angular velocity [rad/s] [FRD] (3,), None for zero
        """
        self._set_motion(index, p_n, q_nb, v_n, omega_b)
        self._clearance.reset()
        self._end_standstill()
        if index in self.in_pybullet:
            self._room.move(index, self._motion(index))

    def close(self) -> None:
        """End pybullet's physics simulation."""
        self._room.close()

    def _set_in_pybullet(self, near: list[int]) -> None:
        """Set which vehicles pybullet moves from now on. A compiled function moves all other vehicles.

        near: rows of the vehicles that pybullet moves
        """
        before = set(self.in_pybullet)
        for i in sorted(before.difference(near)):
            self._room.remove(i)
        for i in sorted(set(near).difference(before)):
            self._room.add(i, self._motion(i))
        self.in_pybullet, self._rows = near, np.array(near, int)
        self._end_standstill()
        self._free[:] = True
        self._free[self._rows] = False

    def _end_standstill(self) -> None:
        self._standing = None
        if self._standstill is not None:
            self._standstill.end()

    def _motion(self, i: int) -> Motion:
        state = self._state
        return Motion(place=state.place[i], quat=state.quat[i], speed=state.speed[i], rate=state.rate[i])

    def _set_motion(
        self, i: int, p_n: Array, q_nb: Array, v_n: Array | None = None, omega_b: Array | None = None
    ) -> None:
        omega_n = np.zeros(3) if omega_b is None else quat_rotate(q_nb, omega_b)
        motion = self._motion(i)
        motion.place[:], motion.quat[:] = world_from_ned(p_n), xyzw_from_wxyz(q_wf_from_q_nb(q_nb))
        motion.speed[:] = world_from_ned(np.zeros(3) if v_n is None else v_n)
        motion.rate[:] = world_from_ned(omega_n)
        self._law.publish(i)
