"""The world: one object that turns motor commands into motion and measurements. No socket, no clock, no file.

world = World(settings)            settings: the world slice of the plan
world.step(motors)                 one sensor period, in physics steps of which it holds a whole number
world.truth(), world.sense()       what is, and what the vehicles would measure
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.sim.battery import Battery
from arena.sim.bodies import Bodies
from arena.sim.crash_detector import Judge
from arena.sim.rotors import Rotors
from arena.sim.scalar_step import MOST, Few
from arena.sim.sensors import Origin, Sensors
from arena.sim.vehicle_arrays import read_fleet
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]

_G_N = np.array([0.0, 0.0, GRAVITY_M_S2])


class World:
    """period_s: the sensor period [s]. steps: how many have passed. Raises InputError where the slice makes
    no world.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self._substeps = substeps(float(settings["physics_hz"]), float(settings["sensor_hz"]))
        self.period_s, self._h = 1.0 / float(settings["sensor_hz"]), 1.0 / float(settings["physics_hz"])
        self.fleet = read_fleet(list(settings["vehicles"]))
        self.bodies = Bodies(
            self.fleet, size_m=settings["size_m"], step_s=self._h, gui=bool(settings.get("gui"))
        )
        self._rotors = Rotors(self.fleet, step_s=self._h)
        few = self.fleet.size <= MOST
        self._few = Few(self.fleet, self.bodies, self._rotors, step_s=self._h) if few else None
        self._battery = Battery(self.fleet, step_s=self.period_s)
        self._judge = Judge(self.fleet.names, step_s=self.period_s)
        origin, heading = settings.get("origin"), math.radians(float(settings.get("heading_deg", 0.0)))
        self._sensors = Sensors(
            self.fleet,
            seed=int(settings["seed"]),
            heading_rad=heading,
            origin=Origin(**origin) if origin else None,
        )
        self.wind_n: Array = np.array(settings.get("wind_m_s") or (0.0, 0.0, 0.0), float)
        self.steps = self._watched = 0
        # Before the first step every vehicle is held at its start, which feels like standing: 1 g.
        self._accel_b = -(_G_N @ self.bodies.r_nb)

    @property
    def now(self) -> float:
        """Simulation time [s]: a multiple of the period, without the error of a running sum."""
        return self.steps * self.period_s

    def step(self, motors: Array) -> None:
        """motors: commands 0..1 (V, R), held for one sensor period: `move`, then `watch`."""
        self.move(motors)
        self.watch()

    def move(self, motors: Array) -> None:
        """One sensor period passes for the bodies. Nothing else may be asked of the judge or the batteries before `watch`."""
        motors = np.fmin(np.fmax(motors, 0.0), 1.0)  # what is no number becomes 0
        if self._few is not None:
            self._accel_b = self._few.move(motors, self.wind_n, self._substeps)
        else:
            felt = self._substep(motors)
            for _ in range(self._substeps - 1):
                felt += self._substep(motors)
            self._accel_b = felt / self._substeps
        self.steps += 1

    def watch(self) -> None:
        """What a step means for batteries and verdicts: once after each `move`, when there is time for it."""
        if self._watched == self.steps:
            return
        self._watched = self.steps
        self._battery.step(self._rotors.spin)
        if self._rotors.sags:
            self._rotors.supply = self._battery.supply
        bodies, contacts = self.bodies, self.bodies.contacts()
        self._judge.watch(
            now=self.now,
            p_n=bodies.p_n,
            v_n=bodies.v_n,
            cos_tilt=bodies.r_nb[:, 2, 2],
            floor=contacts.floor,
            others=contacts.others,
        )

    def _substep(self, motors: Array) -> Array:
        """Returns the specific force: all that moved the body but gravity, contacts too [m/s2] [FRD] (V,
        3).
        """
        bodies = self.bodies
        r_nb, v_n = bodies.r_nb, bodies.v_n
        bodies.push(*self._rotors.step(motors, _b_from_n(r_nb, v_n - self.wind_n), -bodies.p_n[:, 2]))
        bodies.step()
        return _b_from_n(r_nb, (bodies.v_n - v_n) / self._h - _G_N)

    # -- spoiled on purpose ----------------------------------------------------------------------------------------------

    def weaken(self, vehicle: int, rotor: int, share: float) -> None:
        """Of a rotor's thrust (0..) that share is left, 0..1 [-]; it turns on as it is told."""
        self._rotors.weaken(vehicle, rotor, share)
        if self._few is not None:
            self._few.fit(vehicle)

    def drain(self, vehicle: int, empty_in_s: float | None) -> None:
        """The battery falls at the pace full to empty in so long; None: as the motors draw."""
        self._battery.drain(vehicle, empty_in_s)

    def blow(self, wind_n: Sequence[float]) -> None:
        """The wind from now on [m/s] [NED] (3,)."""
        self.wind_n = np.array(wind_n, float)

    # -- what is to be known ---------------------------------------------------------------------------------------------

    def truth(self) -> Truth:
        bodies, motors = self.bodies, self._rotors.spin
        if self.fleet.rotors != 4:
            motors = np.zeros((self.fleet.size, 4))
            motors[:, : min(4, self.fleet.rotors)] = self._rotors.spin[:, :4]
        return Truth(
            time_s=self.now,
            p_n=bodies.p_n,
            q_nb=bodies.q_nb,
            v_n=bodies.v_n,
            omega_b=bodies.omega_b,
            accel_b=self._accel_b,
            motors=motors,
        )

    def sense(self) -> dict[str, Array]:
        """One draw of every sensor; call it once a step. See Sensors.sense, and battery_v [V],
        battery_current_a [A], battery_remaining 0..1 [-], each (V,).
        """
        bodies, battery = self.bodies, self._battery
        found = self._sensors.sense(
            accel_b=self._accel_b, omega_b=bodies.omega_b, r_nb=bodies.r_nb, p_n=bodies.p_n
        )
        found["battery_v"], found["battery_current_a"] = battery.voltage, battery.current
        found["battery_remaining"] = battery.remaining
        return found

    def gps(self) -> dict[str, Array]:
        """One draw of the satellite receivers, for those who want it at their own rate. See Sensors.gps."""
        return self._sensors.gps(p_n=self.bodies.p_n, v_n=self.bodies.v_n)

    def judge(self) -> dict[str, dict[str, Any]]:
        """Vehicle name -> its verdict so far. See judge.Verdict."""
        return self._judge.report()

    def events(self) -> list[str]:
        """Crashes since the last call, one line each."""
        return self._judge.events()

    def close(self) -> None:
        self.bodies.close()


def substeps(physics_hz: float, sensor_hz: float) -> int:
    """Physics steps in a sensor period. Raises InputError when that is not a whole number of at least one."""
    ratio = physics_hz / sensor_hz if sensor_hz > 0 else 0.0
    if ratio < 1.0 or abs(ratio - round(ratio)) > 1e-9:
        raise InputError(
            f"physics_hz: got {physics_hz:g}, must be a whole multiple of sensor_hz ({sensor_hz:g}). "
            f"Try {max(1, round(ratio)) * sensor_hz:g}."
        )
    return round(ratio)


def _b_from_n(r_nb: Array, v_n: Array) -> Array:
    """Body axes from NED (V, 3): as a row vector, v R is R^T v."""
    turned: Array = (v_n[:, None, :] @ r_nb)[:, 0]
    return turned
