"""Simulated world: computes motion and measurements from motor commands. No socket, no clock, no file.

world = World(settings)                 settings: the JSON configuration (slice) of the world
world.step(motors)                      advance by one sensor period
world.truth(), world.sense()            the true state, and one sample of every sensor
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.obstacles import obstacles_of
from arena.sim.battery import Battery
from arena.sim.bodies import Bodies
from arena.sim.crash_detector import CrashDetector
from arena.sim.downwash import Downwash
from arena.sim.gusts import Gusts
from arena.sim.sensors import SENSORS, GlobalOrigin, Motion, SensorSuite, Site
from arena.sim.vehicle_arrays import Fleet, read_fleet
from arena.vehicle_models import Dynamics, vehicle_model
from arena.wire.truth_page import Truth

Array = NDArray[np.float64]

_DOWNWASH_S = 0.02
"""Time for which the downwash is held [s]. At 2 m/s a vehicle moves by 4 cm, a fifth of the width of a jet."""


class World:
    """Simulation of V vehicles: bodies, actuators, batteries, sensors and crash detection.

    period_s: sensor period [s]
    steps: number of sensor periods so far
    wind_n: steady wind at each vehicle [m/s] [NED] (V, 3)

    Raises InputError if the settings are not valid.
    """

    def __init__(self, settings: Mapping[str, Any]) -> None:
        self._substeps = substeps(float(settings["physics_hz"]), float(settings["sensor_hz"]))
        self.period_s, step_s = 1.0 / float(settings["sensor_hz"]), 1.0 / float(settings["physics_hz"])
        self.fleet = read_fleet(list(settings["vehicles"]))
        self.bodies = Bodies(
            self.fleet,
            size_m=settings["size_m"],
            ceiling=bool(settings.get("ceiling", True)),
            obstacles=obstacles_of(settings.get("obstacles")),
            step_s=step_s,
            period_s=self.period_s,
            gui=bool(settings.get("gui")),
        )
        self._dynamics = _dynamics(self.fleet, step_s)
        self._flight = self.bodies.free_flight(self._dynamics)
        self._battery = Battery(
            self.fleet.profiles,
            self._dynamics.hover,
            self._dynamics.supply_per_volt,
            spin=self._dynamics.spin,
            step_s=self.period_s,
        )
        limits = [vehicle_model(p).crash_limits for p in self.fleet.profiles]
        bodies = self.bodies
        self._crashes = CrashDetector(
            self.fleet.names,
            limits,
            p_n=bodies.p_n,
            v_n=bodies.v_n,
            r_nb=bodies.r_nb,
            step_s=self.period_s,
        )
        origin, heading = settings.get("origin"), math.radians(float(settings.get("heading_deg", 0.0)))
        self._sensors = SensorSuite(
            SENSORS,
            self.fleet.profiles,
            self.fleet.ids,
            seed=int(settings["seed"]),
            site=Site(heading_rad=heading, origin=GlobalOrigin(**origin) if origin else None),
            period_s=self.period_s,
        )
        everywhere = settings.get("wind_m_s") or (0.0, 0.0, 0.0)
        self.wind_n: Array = np.array([v.get("wind_m_s") or everywhere for v in settings["vehicles"]], float)
        self._gusts = self._gust_model(settings)
        downwash = Downwash(self.fleet.profiles, strength=float(settings.get("downwash", 1.0)))
        self._downwash = downwash if downwash.acts else None
        self._downwash_steps = max(1, round(_DOWNWASH_S / self.period_s))
        self._downwash_n: Array = np.zeros((self.fleet.size, 3))
        self.steps = self._observed_steps = 0
        # Before the first step every vehicle stands at its start, so its specific force is 1 g.
        bodies.mean_accel_b[...] = -GRAVITY_M_S2 * bodies.r_nb[:, 2]
        self._state = (
            bodies.p_n,
            bodies.q_nb,
            bodies.v_n,
            bodies.omega_b,
            bodies.mean_accel_b,
            self._dynamics.spin,
        )
        self._motion = Motion(
            accel_b=bodies.mean_accel_b,
            omega_b=bodies.omega_b,
            r_nb=bodies.r_nb,
            p_n=bodies.p_n,
            v_n=bodies.v_n,
            spin=self._dynamics.spin,
            hover=self._dynamics.hover,
        )

    def _gust_model(self, settings: Mapping[str, Any]) -> Gusts | None:
        wind_20ft = float(settings.get("gusts_m_s", 0.0))
        if wind_20ft == 0.0:
            return None
        return Gusts(self.fleet.ids, seed=int(settings["seed"]), wind_20ft=wind_20ft, step_s=self.period_s)

    @property
    def now(self) -> float:
        """Simulation time [s]. It is a multiple of the period, so that rounding errors do not accumulate."""
        return self.steps * self.period_s

    @property
    def hover(self) -> Array:
        """Motor command at which each vehicle hovers [-] (V,)."""
        return self._dynamics.hover

    @property
    def rotors(self) -> int:
        """Largest number of rotors of a vehicle, R. It is the number of motor commands per vehicle."""
        return int(self._dynamics.spin.shape[1])

    def step(self, motors: Array) -> None:
        """Simulate one sensor period: move the bodies, then update batteries and crash detection.

        motors: motor commands 0..1 [-] (V, R)
        """
        self.advance(motors)
        self.observe()

    def advance(self, motors: Array) -> None:
        """Move the bodies by one sensor period.

        Batteries and crash detection are out of date until `observe` is called.

        motors: motor commands, constant for the period, limited to 0..1; NaN counts as 0 [-] (V, R)
        """
        bodies, dynamics = self.bodies, self._dynamics
        self._flight.set_motors(motors)
        if self._battery.is_weak:
            dynamics.motors *= self._battery.command_factor
        bodies.begin(self._wind())
        if bodies.needs_pybullet():
            for _ in range(self._substeps):
                bodies.step(*dynamics.step(dynamics.motors, bodies.air_b, bodies.height))
        else:
            self._flight.step(self._substeps)
        bodies.finish(self._substeps)
        self.steps += 1

    def observe(self) -> None:
        """Update batteries and crash detection. Call it once after each `advance`."""
        if self._observed_steps == self.steps:
            return
        self._observed_steps = self.steps
        self._battery.step()
        if self._dynamics.voltage_matters:
            self._dynamics.supply[:] = self._battery.supply
        contacts = self.bodies.contacts()
        self._crashes.step(now=self.now, floor=contacts.floor, others=contacts.others)

    def _wind(self) -> Array:
        """Return the wind at each vehicle in this period [m/s] [NED] (V, 3): steady wind, gusts and downwash."""
        bodies, wind_n = self.bodies, self.wind_n
        if self._gusts is not None:
            wind_n = wind_n + self._gusts.step(-bodies.p_n[:, 2], bodies.v_n, self.wind_n)
        if self._downwash is not None:
            if self.steps % self._downwash_steps == 0:
                self._downwash_n = self._downwash.wind(bodies.p_n, bodies.r_nb, self._dynamics.thrust)
            wind_n = wind_n + self._downwash_n
        return wind_n

    # -- fault injection ---------------------------------------------------------------------------------------------

    def scale_rotor_thrust(self, vehicle: int, rotor: int, share: float) -> None:
        """Scale the thrust of one rotor, as a fault. The rotor speed still follows the commands.

        rotor: index from 0
        share: remaining share of the thrust 0..1 [-]
        """
        self._dynamics.scale_thrust(vehicle, rotor, share)

    def override_discharge(self, vehicle: int, empty_in_s: float | None) -> None:
        """Set a constant discharge rate of one battery.

        empty_in_s: time from full to empty [s]; None restores the load model
        """
        self._battery.override_discharge(vehicle, empty_in_s)

    def set_wind(self, wind_n: Sequence[float]) -> None:
        """Set the steady wind at every vehicle [m/s] [NED] (3,)."""
        self.wind_n = np.tile(np.array(wind_n, float), (self.fleet.size, 1))

    # -- results -----------------------------------------------------------------------------------------------------

    def truth(self) -> Truth:
        """Return a copy of the current true state of all vehicles."""
        return Truth(self.now, *(values.copy() for values in self._state))

    def live_truth(self) -> Truth:
        """Return the current true state of all vehicles, in arrays that the next step overwrites."""
        return Truth(self.now, *self._state)

    def sense(self, requested: Collection[str] = ()) -> dict[str, Array]:
        """Return one sample of every sensor. Call it once per step.

        requested: names of the sensors to sample in addition, which are sampled on request only, such as
            "gps"

        The next call overwrites the arrays. Returns the readings of `arena.sim.sensors`, and battery_v [V], battery_current_a [A],
        battery_remaining 0..1 [-], each (V,).
        """
        battery = self._battery
        found = self._sensors.sample(self._motion, requested)
        found["battery_v"], found["battery_current_a"] = battery.voltage.copy(), battery.current.copy()
        found["battery_remaining"] = battery.remaining.copy()
        return found

    def flights(self) -> dict[str, dict[str, Any]]:
        """Return vehicle name -> flight record (crash, landings, extreme values), as JSON-ready objects."""
        return self._crashes.report()

    def events(self) -> list[str]:
        """Return one text line for each crash since the last call."""
        return self._crashes.events()

    def close(self) -> None:
        """End the physics simulation."""
        self.bodies.close()


def substeps(physics_hz: float, sensor_hz: float) -> int:
    """Return the number of physics steps in a sensor period.

    Raises InputError if it is not an integer of at least 1.
    """
    ratio = physics_hz / sensor_hz if sensor_hz > 0 else 0.0
    if ratio < 1.0 or abs(ratio - round(ratio)) > 1e-9:
        raise InputError(
            f"physics_hz: got {physics_hz:g}, expected an integer multiple of sensor_hz ({sensor_hz:g}). "
            f"Try {max(1, round(ratio)) * sensor_hz:g}."
        )
    return round(ratio)


def _dynamics(fleet: Fleet, step_s: float) -> Dynamics:
    """Return the equations of motion of a fleet. Raises InputError for different vehicle classes in one world."""
    models = {model.name: model for model in map(vehicle_model, fleet.profiles)}
    if len(models) > 1:
        raise InputError(
            f"all vehicles of one world must have the same vehicle_class: got {', '.join(sorted(models))}. "
            "Give each class an arena.yaml of its own."
        )
    (model,) = models.values()
    return model.dynamics(fleet.profiles, step_s=step_s)
