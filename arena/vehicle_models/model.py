"""Protocols of a vehicle class: its facts, its actuators' effect, and its dynamics over all vehicles at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Profile = Mapping[str, Any]
"""A vehicle's profile as the slices carry it."""
Triple = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class CrashLimits:
    """Limits above which the world counts a crash.

    touchdown_m_s: speed at a touchdown [m/s]
    tilt_rad: angle between the body's z axis and the vertical [rad]
    """

    touchdown_m_s: float
    tilt_rad: float


class ScalarDynamics(Protocol):
    """`Dynamics` of one vehicle in plain floats: faster than numpy for one or two vehicles."""

    def update(self) -> None:
        """Read again what `Dynamics.scale_thrust` may have changed."""
        ...

    def step(
        self, spin: list[float], motors: list[float], air_b: Triple, height: float
    ) -> tuple[Triple, Triple]:
        """Advance by one physics step, in place of `Dynamics.step`; `spin` is updated in place."""
        ...


class Dynamics(Protocol):
    """Actuators of V vehicles of one class: commands -> force and torque on the bodies, batched.

    spin: state of the actuators, as the command that would hold it, 0..1 [-] (V, R)
    supply: battery voltage per nominal voltage [-] (V, 1); the world writes it
    voltage_matters: whether `supply` changes anything
    hover: command that carries each vehicle at rest [-] (V,)
    supply_per_volt: `supply` per volt of the battery [1/V], 0 for a vehicle whose thrust ignores the voltage (V,)
    """

    spin: Array
    supply: Array

    @property
    def voltage_matters(self) -> bool: ...

    @property
    def hover(self) -> Array: ...

    @property
    def supply_per_volt(self) -> Array: ...

    def step(self, motors: Array, air_b: Array, height: Array) -> tuple[Array, Array]:
        """Advance by one physics step.

        motors: commands 0..1 [-] (V, R)
        air_b: velocity through the air [m/s] [FRD] (V, 3)
        height: of the body origins above the floor [m] (V,)

        Returns force [N] and torque about the centre of mass [N m], both [FRD] (V, 3).
        """
        ...

    def scale_thrust(self, vehicle: int, rotor: int, share: float) -> None:
        """Scale one rotor's thrust and torque to a share 0..1 [-]; its speed still follows commands."""
        ...

    def scalar(self, vehicle: int) -> ScalarDynamics:
        """Return the same dynamics for one vehicle in plain floats."""
        ...


class VehicleModel(Protocol):
    """A class of vehicles.

    name: as in the profile's `vehicle_class`
    mav_type: MAV_TYPE of its heartbeats
    px4_sim_model: PX4_SIM_MODEL that PX4 SITL is started with, which selects its airframe
    px4_autostart: SYS_AUTOSTART of that airframe
    crash_limits: what counts as a crash
    """

    @property
    def name(self) -> str: ...

    @property
    def mav_type(self) -> int: ...

    @property
    def px4_sim_model(self) -> str: ...

    @property
    def px4_autostart(self) -> int: ...

    @property
    def crash_limits(self) -> CrashLimits: ...

    def allocation(self, actuators: Sequence[Mapping[str, Any]]) -> Array:
        """Return the weights of roll, pitch and yaw torque for each actuator, normalised as PX4's (R, 3)."""
        ...

    def dynamics(self, profiles: Sequence[Profile], *, step_s: float) -> Dynamics:
        """Return the dynamics of vehicles of this class. step_s: physics step [s]."""
        ...
