"""Rotors of multirotors: motor lag, thrust, reaction torque, air drag, ground effect.

Pure, batched over vehicles.

Lag: first order, faster up than down, as in PX4's Gazebo models (RotorS: Furrer, Burri, Achtelik and
Siegwart, 2016).

Thrust: the profile's static curve at the lagged command. It decreases with airspeed as defined by that curve.

Supply: a motor controller without feedback turns its motor in proportion to command times voltage. So the
lagged command follows motors * volts / thrust_at_v of the profile's battery. Without `thrust_at_v`, thrust
does not depend on the voltage.

Rotor drag: linear in the airspeed (blade flapping and induced drag: Mahony, Kumar and Corke, "Multirotor
aerial vehicles", 2012, section III-B), and proportional to the rotors' speed, which is proportional to the
square root of the thrust. The profile's value is for hover. Faessler, Franchi and Scaramuzza (2018) found
that such a constant is accurate enough up to 5 m/s.

Body drag: quadratic in the airspeed, along each body axis.

With the motors off the rotors stand still and have no linear drag: only the body drag remains.

Rotor acceleration: a motor that turns its rotor faster turns the body the other way, with the torque J times
the change of speed per time, J: moment of inertia of rotor and propeller. The speed is sqrt(T / k), T: static
thrust. This torque is zero unless the profile has `rotor_inertia`.

Ground effect: thrust grows near the floor; see `ground_effect.py`. The downwash of other vehicles is wind;
see `arena/sim/downwash.py`.

Not modelled: the gyroscopic torque of the rotors, walls and ceilings near the rotors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.kernels.arrays import array
from arena.kernels.rotor_dynamics import RotorDynamics
from arena.portable_math import exp
from arena.thrust_curve import thrust_curve
from arena.vehicle_models.ground_effect import CELLS, ground_table
from arena.vehicle_models.model import Profile
from arena.vehicle_models.rotor_geometry import SPIN, actuator_effect

if TYPE_CHECKING:
    from arena.vehicle_models.model import Array

GRID = 1024
"""Cells of the thrust table between the commands 0 and 1."""


class Rotors:
    """Dynamics of V multirotors with at most R rotors each.

    All arrays have R columns; a vehicle with fewer rotors does not use the last columns.

    spin: rotor state, given as the command that would maintain it at nominal voltage, 0..1 [-] (V, R)
    wrench: matrix from thrusts (R,) to torque x, y, z [N m] and force z [N] [FRD] (V, 4, R)
    supply: battery voltage divided by nominal voltage, 1 if thrust does not depend on it [-] (V,)
    hover: motor command at which each vehicle hovers [-] (V,)
    supply_per_volt: `supply` per volt of the battery [1/V] (V,)
    """

    def __init__(self, profiles: Sequence[Profile], *, step_s: float) -> None:
        self.size, self.rotors = len(profiles), max(len(p["rotors"]) for p in profiles)
        self.law = law = RotorDynamics(self.size, self.rotors, GRID, CELLS)
        self.spin, self.wrench, self.supply = array(law.spin), array(law.wrench), array(law.supply)
        self.motors = array(law.motors)
        self._inputs = self.motors, array(law.air_b), array(law.height)
        self._outputs = array(law.force), array(law.torque)
        self.hover: Array = np.array([_hover(p) for p in profiles])
        self.supply_per_volt: Array = np.array([_supply_per_volt(p) for p in profiles])
        self.voltage_matters = bool(self.supply_per_volt.any())
        self._wrench_intact = np.stack([wrench_matrix(p, self.rotors) for p in profiles])
        self.wrench[:] = self._wrench_intact
        self._read_motors(profiles, step_s)
        self._read_inertia(profiles, step_s)
        self._read_drag(profiles)
        self._read_ground(profiles)

    def _read_motors(self, profiles: Sequence[Profile], step_s: float) -> None:
        for to, key, default in (
            (self.law.rise, "motor_up_s", 0.0125),
            (self.law.fall, "motor_down_s", 0.025),
        ):
            array(to)[:] = 1.0 - exp(-step_s / np.maximum(_column(profiles, key, default), 1e-6))
        curves = [_curve(p) for p in profiles]
        tables = array(self.law.thrust_table)
        tables[:] = [table for table, _ in curves]
        # Vehicles with equal motors are interpolated in one call.
        distinct, group = np.unique(tables, axis=0, return_inverse=True)
        self._commands = np.linspace(0.0, 1.0, GRID + 1)
        self._thrust_tables = [
            (np.flatnonzero(group.ravel() == k), table) for k, table in enumerate(distinct)
        ]
        array(self.law.speed_loss)[:] = [loss for _, loss in curves]

    def _read_inertia(self, profiles: Sequence[Profile], step_s: float) -> None:
        given = [p.get("rotor_inertia") or {"moment_kg_m2": 0.0, "thrust_n_s2": 1.0} for p in profiles]
        per_thrust = np.array([1.0 / g["thrust_n_s2"] for g in given])
        array(self.law.speed_table)[:] = np.sqrt(array(self.law.thrust_table) * per_thrust[:, None])
        moment = np.array([g["moment_kg_m2"] for g in given]) / step_s
        array(self.law.spin_up)[:] = moment[:, None] * np.stack(
            [reaction_sign(p, self.rotors) for p in profiles]
        )

    def _read_drag(self, profiles: Sequence[Profile]) -> None:
        array(self.law.drag)[:] = [p.get("drag_kg_s", (0.2, 0.2, 0.2)) for p in profiles]
        array(self.law.body_drag)[:] = [p.get("body_drag_kg_m", (0.0, 0.0, 0.0)) for p in profiles]
        array(self.law.per_weight)[:] = [1.0 / (float(p["mass_kg"]) * GRAVITY_M_S2) for p in profiles]

    def _read_ground(self, profiles: Sequence[Profile]) -> None:
        for i, profile in enumerate(profiles):
            table, scale, reach = ground_table(profile)
            array(self.law.ground_table)[i] = table
            array(self.law.ground_scale)[i], array(self.law.ground_reach)[i] = scale, reach

    def scale_thrust(self, vehicle: int, rotor: int, share: float) -> None:
        """Simulate a damaged rotor with less thrust and torque.

        The rotor speed still follows the motor command.

        share: remaining share of the thrust 0..1 [-]
        """
        self.wrench[vehicle, :, rotor] = share * self._wrench_intact[vehicle, :, rotor]

    def step(self, motors: Array, air_b: Array, height: Array) -> tuple[Array, Array]:
        """Compute one physics step of all rotors. Return force and torque on each body.

        motors: motor commands 0..1 [-] (V, R)
        air_b: velocity relative to the air [m/s] [FRD] (V, 3)
        height: height of the body origins above the floor [m] (V,)

        Returns force [N] and torque about the centre of mass [N m], both [FRD] (V, 3). The next step changes both
        arrays.
        """
        for to, values in zip(self._inputs, (motors, air_b, height), strict=True):
            to[...] = values
        self.law.step()
        return self._outputs

    def thrust(self) -> Array:
        """Return the thrust of all rotors of each vehicle in still air far from the floor [N] (V,)."""
        each = np.empty_like(self.spin)
        for rows, table in self._thrust_tables:
            each[rows] = np.interp(self.spin[rows], self._commands, table)
        return np.asarray(-(self.wrench[:, 3] * each).sum(1))


def reaction_sign(profile: Profile, columns: int) -> Array:
    """Return the sign of the torque about z that each rotor exerts on the body when it speeds up [FRD] (columns,).

    The sign is 1 for a rotor that turns ccw seen from above, and -1 for cw.

    columns: number of columns, at least the number of rotors; the columns of missing rotors are zero
    """
    out = np.zeros(columns)
    out[: len(profile["rotors"])] = [SPIN[rotor["direction"]] for rotor in profile["rotors"]]
    return out


def wrench_matrix(profile: Profile, columns: int) -> Array:
    """Return the matrix from rotor thrusts to torques and vertical force [FRD] (4, columns).

    Input [N]; output torque x, y, z [N m] and force z [N].

    columns: number of columns, at least the number of rotors; the columns of missing rotors are zero
    """
    out = np.zeros((4, columns))
    for i, rotor in enumerate(profile["rotors"]):
        try:
            out[:, i] = actuator_effect(rotor, moment_ratio_m=float(profile.get("moment_ratio_m", 0.016)))
        except InputError as error:
            raise InputError(f"rotor {i + 1}: {error}") from error
    return out


def _column(profiles: Sequence[Profile], key: str, default: float) -> Array:
    return np.array([p.get(key, default) for p in profiles], float)


def _curve(profile: Profile) -> tuple[Array, float]:
    """Tabulate the thrust of one rotor over its motor command.

    Returns the rotor's thrust at each command of the grid [N] (GRID + 1,), and the share of the thrust that is lost
    per airspeed [s/m].
    """
    curve = thrust_curve(profile["thrust_curve"])
    return curve.newtons(np.linspace(0.0, 1.0, GRID + 1)) / len(profile["rotors"]), 1.0 / curve.fade_speed_m_s


def _supply_per_volt(profile: Profile) -> float:
    nominal = profile.get("battery", {}).get("thrust_at_v")
    return 1.0 / float(nominal) if nominal else 0.0


def _hover(profile: Profile) -> float:
    return float(thrust_curve(profile["thrust_curve"]).command(float(profile["mass_kg"]) * GRAVITY_M_S2))
