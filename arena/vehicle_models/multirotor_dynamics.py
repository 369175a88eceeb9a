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

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from arena.constants import GRAVITY_M_S2
from arena.errors import InputError
from arena.thrust_curve import thrust_curve
from arena.vehicle_models.ground_effect import CELLS, ground_table
from arena.vehicle_models.model import Array, Profile, Triple

MIN_THRUST_SHARE = 0.1  # as in the thrust curve: this share remains at any airspeed
GRID = 1024
"""Cells of the thrust table between the commands 0 and 1."""
_SPIN = {"ccw": 1.0, "cw": -1.0}


class Rotors:
    """Dynamics of V multirotors with at most R rotors each. All arrays have R columns; a vehicle with fewer
    rotors does not use the last columns.

    spin: rotor state, given as the command that would maintain it at nominal voltage, 0..1 [-] (V, R)
    wrench: matrix from thrusts (R,) to torque x, y, z [N m] and force z [N] [FRD] (V, 4, R)
    supply: battery voltage divided by nominal voltage, 1 if thrust does not depend on it [-] (V, 1)
    hover: motor command at which each vehicle hovers [-] (V,)
    supply_per_volt: `supply` per volt of the battery [1/V] (V,)
    """

    def __init__(self, profiles: Sequence[Profile], *, step_s: float) -> None:
        self.size, self.rotors = len(profiles), max(len(p["rotors"]) for p in profiles)
        self.spin: Array = np.zeros((self.size, self.rotors))
        self.supply: Array = np.ones((self.size, 1))
        self.hover: Array = np.array([_hover(p) for p in profiles])
        self.supply_per_volt: Array = np.array([_supply_per_volt(p) for p in profiles])
        self.voltage_matters = bool(self.supply_per_volt.any())
        self._wrench_intact = np.stack([wrench_matrix(p, self.rotors) for p in profiles])
        self.wrench: Array = self._wrench_intact.copy()
        self._read_motors(profiles, step_s)
        self._read_inertia(profiles, step_s)
        self._read_drag(profiles)
        self._read_ground(profiles)

    def _read_motors(self, profiles: Sequence[Profile], step_s: float) -> None:
        # Share of the gap to the command that one step closes (V, 1).
        self._rise = (
            1.0 - np.exp(-step_s / np.maximum(_column(profiles, "motor_up_s", 0.0125), 1e-6))[:, None]
        )
        self._fall = (
            1.0 - np.exp(-step_s / np.maximum(_column(profiles, "motor_down_s", 0.025), 1e-6))[:, None]
        )
        curves = [_curve(p) for p in profiles]
        thrust = np.stack([table for table, _ in curves])
        # All tables in one array, and the slope of each cell: a look-up is one `take`, not one per vehicle.
        self._table, self._slope = thrust.ravel(), np.diff(thrust, axis=1, append=thrust[:, -1:]).ravel()
        self._row = np.arange(self.size)[:, None] * (GRID + 1)
        self._speed_loss: Array = np.array([loss for _, loss in curves])  # share lost per airspeed [s/m]
        self._fades = bool(self._speed_loss.any())

    def _read_inertia(self, profiles: Sequence[Profile], step_s: float) -> None:
        given = [p.get("rotor_inertia") or {"moment_kg_m2": 0.0, "thrust_n_s2": 1.0} for p in profiles]
        per_thrust = np.array([1.0 / g["thrust_n_s2"] for g in given])
        speed = np.sqrt(self._table.reshape(self.size, -1) * per_thrust[:, None])  # [rad/s]
        self._speed, self._speed_slope = speed.ravel(), np.diff(speed, axis=1, append=speed[:, -1:]).ravel()
        moment = np.array([g["moment_kg_m2"] for g in given]) / step_s
        # Torque about the body's z axis per change of speed in one step [N m s] (V, R).
        self._spin_up: Array = moment[:, None] * np.stack([turning(p, self.rotors) for p in profiles])
        self._has_inertia = bool(self._spin_up.any())

    def _read_drag(self, profiles: Sequence[Profile]) -> None:
        self._drag = -np.array([p.get("drag_kg_s", (0.2, 0.2, 0.2)) for p in profiles], float)
        self._body_drag = -np.array([p.get("body_drag_kg_m", (0.0, 0.0, 0.0)) for p in profiles], float)
        self._has_body_drag = bool(self._body_drag.any())
        self._per_weight = -1.0 / (np.array([p["mass_kg"] for p in profiles], float) * GRAVITY_M_S2)

    def _read_ground(self, profiles: Sequence[Profile]) -> None:
        grounds = [ground_table(p) for p in profiles]
        self._ground = np.concatenate([table for table, _, _ in grounds])
        self._ground_scale = np.array([scale for _, scale, _ in grounds])
        self._ground_reach = np.array([reach for _, _, reach in grounds])
        self._reach = float(self._ground_reach.max())

    def scale_thrust(self, vehicle: int, rotor: int, share: float) -> None:
        """Scale thrust and torque of one rotor. The rotor speed still follows commands.

        share: remaining share of the thrust 0..1 [-]
        """
        self.wrench[vehicle, :, rotor] = share * self._wrench_intact[vehicle, :, rotor]

    def step(self, motors: Array, air_b: Array, height: Array) -> tuple[Array, Array]:
        """Compute one physics step of all rotors. Return force and torque on each body.

        motors: motor commands 0..1 [-] (V, R)
        air_b: velocity relative to the air [m/s] [FRD] (V, 3)
        height: height of the body origins above the floor [m] (V,)

        Returns force [N] and torque about the centre of mass [N m], both [FRD] (V, 3).
        """
        before = self.spin
        gap = (np.minimum(motors * self.supply, 1.0) if self.voltage_matters else motors) - before
        self.spin = before + gap * np.where(gap > 0.0, self._rise, self._fall)
        wrench = (self.wrench @ self._thrust(air_b, height)[:, :, None])[:, :, 0]
        if self._has_inertia:
            gained = self._look_up(self.spin, self._speed, self._speed_slope)
            gained -= self._look_up(before, self._speed, self._speed_slope)
            wrench[:, 2] += (gained * self._spin_up).sum(1)
        lift = wrench[:, 3]
        force = air_b * self._drag
        force *= np.sqrt(lift * self._per_weight)[:, None]  # lift and per_weight are both negative
        if self._has_body_drag:
            force += air_b * np.abs(air_b) * self._body_drag
        force[:, 2] += lift
        return force, wrench[:, :3]

    def scalar(self, vehicle: int) -> ScalarRotors:
        """Return the dynamics of one vehicle, computed in plain floats instead of arrays, because this is faster for few vehicles."""
        return ScalarRotors(self, vehicle)

    def thrust(self) -> Array:
        """Return the thrust of all rotors of each vehicle in still air far from the floor [N] (V,)."""
        each = self._look_up(self.spin, self._table, self._slope)
        return np.asarray(-(self.wrench[:, 3] * each).sum(1))

    def _look_up(self, spin: Array, table: Array, slope: Array) -> Array:
        """Interpolate a table over the command, with its differences `slope`, at the states of the rotors (V, R)."""
        place = spin * GRID
        cell = place.astype(np.intp)
        at = cell + self._row
        return np.asarray(table.take(at) + (place - cell) * slope.take(at))

    def _thrust(self, air_b: Array, height: Array) -> Array:
        """Return each rotor's thrust [N] (V, R)."""
        thrust = self._look_up(self.spin, self._table, self._slope)
        if self._fades:
            lost = np.sqrt(np.add.reduce(air_b * air_b, 1)) * self._speed_loss
            thrust *= np.maximum(1.0 - lost, MIN_THRUST_SHARE)[:, None]
        if height.min() < self._reach:
            thrust *= self._ground_share(height)[:, None]
        return thrust

    def _ground_share(self, height: Array) -> Array:
        """Return the thrust at this height divided by the thrust far from the floor [-] (V,)."""
        place = np.minimum(np.maximum(height * self._ground_scale, 0.0), CELLS - 1e-9)
        cell = place.astype(np.intp)
        at = cell + np.arange(self.size) * (CELLS + 1)
        low, high = self._ground.take(at), self._ground.take(at + 1)
        return np.asarray(low + (place - cell) * (high - low))


class ScalarRotors:
    """Rotor dynamics of a single vehicle in plain floats, which is faster than numpy for few vehicles.

    The equations are those of `Rotors`, and the results are equal except for rounding; a test compares them.
    """

    def __init__(self, rotors: Rotors, vehicle: int) -> None:
        i, first = vehicle, vehicle * (GRID + 1)
        self._rotors, self._vehicle = rotors, vehicle
        self._rise, self._fall = float(rotors._rise[i, 0]), float(rotors._fall[i, 0])
        self._table: list[float] = rotors._table[first : first + GRID + 1].tolist()
        self._slope: list[float] = rotors._slope[first : first + GRID + 1].tolist()
        self._drag, self._body_drag = (
            tuple((-rotors._drag[i]).tolist()),
            tuple((-rotors._body_drag[i]).tolist()),
        )
        self._loss, self._per_weight = float(rotors._speed_loss[i]), float(rotors._per_weight[i])
        self._spin_up: list[float] = rotors._spin_up[i].tolist() if rotors._spin_up[i].any() else []
        self._speed: list[float] = rotors._speed[first : first + GRID + 1].tolist()
        self._ground: list[float] = rotors._ground[i * (CELLS + 1) : (i + 1) * (CELLS + 1)].tolist()
        self._scale, self._reach = float(rotors._ground_scale[i]), float(rotors._ground_reach[i])
        self.update()

    def update(self) -> None:
        """Update the copy of the matrix (rotor thrusts to torque and force) after `Rotors.scale_thrust` has changed the matrix."""
        self._wrench = [tuple(column) for column in self._rotors.wrench[self._vehicle].T.tolist()]

    def step(
        self, spin: list[float], motors: list[float], air_b: Triple, height: float
    ) -> tuple[Triple, Triple]:
        """Compute one physics step of the rotors of one vehicle: update the rotor states `spin` in place, return force and torque.

        Returns force [N] and torque about the centre of mass [N m], both [FRD].
        """
        ax, ay, az = air_b
        share = (
            max(1.0 - math.sqrt(ax * ax + ay * ay + az * az) * self._loss, MIN_THRUST_SHARE)
            if self._loss
            else 1.0
        )
        if height < self._reach:
            share *= self._ground_share(height)
        tx = ty = tz = fz = 0.0
        before = spin.copy() if self._spin_up else spin
        for k, (command, (wx, wy, wz, wf)) in enumerate(zip(motors, self._wrench, strict=True)):
            gap = command - spin[k]
            spin[k] = at = spin[k] + gap * (self._rise if gap > 0.0 else self._fall)
            place = at * GRID
            cell = int(place)
            thrust = (self._table[cell] + (place - cell) * self._slope[cell]) * share
            tx, ty, tz, fz = tx + wx * thrust, ty + wy * thrust, tz + wz * thrust, fz + wf * thrust
        if self._spin_up:
            tz += self._acceleration_torque(before, spin)
        (dx, dy, dz), (bx, by, bz) = self._drag, self._body_drag
        speed = math.sqrt(fz * self._per_weight)  # of the rotors, per that at hover
        dx, dy, dz = dx * speed + bx * abs(ax), dy * speed + by * abs(ay), dz * speed + bz * abs(az)
        return (-dx * ax, -dy * ay, fz - dz * az), (tx, ty, tz)

    def _acceleration_torque(self, before: list[float], after: list[float]) -> float:
        """Return the torque about the body's z axis [N m] of rotors whose states changed in one step."""
        torque = 0.0
        for each, u, v in zip(self._spin_up, before, after, strict=True):
            torque += each * (self._speed_at(v) - self._speed_at(u))
        return torque

    def _speed_at(self, spin: float) -> float:
        place = spin * GRID
        cell = int(place)
        low = self._speed[cell]
        return low + (place - cell) * (self._speed[min(cell + 1, GRID)] - low)

    def _ground_share(self, height: float) -> float:
        place = max(height * self._scale, 0.0)
        cell = int(place)
        low = self._ground[cell]
        return low + (place - cell) * (self._ground[cell + 1] - low)


def actuator_effect(rotor: Mapping[str, Any], *, moment_ratio_m: float) -> tuple[float, float, float, float]:
    """Return torque x, y, z [m] and force z [-] that one rotor produces per unit of thrust [FRD].

    The thrust T pushes along -z at position r: torque r x (0, 0, -T) = (-y T, x T, 0). The reaction torque
    turns the body
    against the rotor: a rotor that turns counter-clockwise seen from above turns the body clockwise, +z.

    Raises InputError if the rotor's direction is not cw or ccw.
    """
    x, y, _ = rotor["position_m"]
    if rotor["direction"] not in _SPIN:
        raise InputError(f"direction: got {rotor['direction']!r}, expected cw or ccw")
    return -y, x, moment_ratio_m * _SPIN[rotor["direction"]], -1.0


def turning(profile: Profile, columns: int) -> Array:
    """Return the sense of the torque on the body about its z axis when a rotor gains speed: 1 for ccw, -1 for cw (columns,).

    columns: number of columns, at least the number of rotors; the columns of missing rotors are zero
    """
    out = np.zeros(columns)
    out[: len(profile["rotors"])] = [_SPIN[rotor["direction"]] for rotor in profile["rotors"]]
    return out


def wrench_matrix(profile: Profile, columns: int) -> Array:
    """Return the matrix from rotor thrusts [N] to torque x, y, z [N m] and force z [N] [FRD] (4, columns).

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
    """Tabulate the thrust of one rotor over its command.

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
