"""Interfaces of a vehicle class, such as multirotors: its constants and its dynamics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.rotor_dynamics import RotorDynamics

    Array = NDArray[np.float64]
Profile = Mapping[str, Any]
"""A vehicle's profile, as in the JSON configuration (slice) of a process."""


@dataclass(frozen=True, kw_only=True)
class CrashLimits:
    """Limits above which the world records a crash.

    touchdown_m_s: speed at touchdown [m/s]
    tilt_rad: angle between the body's z axis and the vertical [rad]
    """

    touchdown_m_s: float
    tilt_rad: float


class Dynamics(Protocol):
    """Interface of the actuators of V vehicles: forces and torques on the bodies from the motor commands.

    spin: state of the actuators, given as the command that would maintain this state, 0..1 [-] (V, R)
    supply: battery voltage divided by nominal voltage [-] (V,); written by the world
    motors: last argument of `step`, which the kernel `law` reads (V, R)
    law: kernel of the actuators
    voltage_matters: whether the thrust of any vehicle depends on `supply`
    hover: motor command at which each vehicle hovers [-] (V,)
    supply_per_volt: `supply` per volt of the battery [1/V], 0 for a vehicle whose thrust does not depend on
        it (V,)
    """

    spin: Array
    supply: Array
    motors: Array
    law: RotorDynamics

    @property
    def voltage_matters(self) -> bool: ...

    @property
    def hover(self) -> Array: ...

    @property
    def supply_per_volt(self) -> Array: ...

    def step(self, motors: Array, air_b: Array, height: Array) -> tuple[Array, Array]:
        """Compute one physics step of the actuators. Return force and torque on each body.

        motors: motor commands 0..1 [-] (V, R)
        air_b: velocity relative to the air [m/s] [FRD] (V, 3)
        height: height of the body origins above the floor [m] (V,)

        Returns force [N] and torque about the centre of mass [N m], both [FRD] (V, 3).
        """
        ...

    def thrust(self) -> Array:
        """Return the thrust of each vehicle in still air far from the floor [N] (V,)."""
        ...

    def scale_thrust(self, vehicle: int, rotor: int, share: float) -> None:
        """Simulate a damaged rotor with less thrust and torque.

        The rotor speed still follows the motor command.

        share: remaining share of the thrust 0..1 [-]
        """
        ...


class VehicleModel(Protocol):
    """Interface of a vehicle class, such as multirotors: MAV_TYPE, control allocation and actuator dynamics.

    name: value of the profile's `vehicle_class`
    px4_sim_model: value of PX4_SIM_MODEL with which PX4 SITL is started; it selects the airframe
    px4_autostart: SYS_AUTOSTART of that airframe
    crash_limits: limits above which the world records a crash
    """

    @property
    def name(self) -> str: ...

    @property
    def px4_sim_model(self) -> str: ...

    @property
    def px4_autostart(self) -> int: ...

    @property
    def crash_limits(self) -> CrashLimits: ...

    def mav_type(self, actuators: int) -> int:
        """Return the MAV_TYPE in the heartbeats of a vehicle with this number of actuators."""
        ...

    def control_problem(self, actuators: Sequence[Mapping[str, Any]]) -> str:
        """Return why the actuators cannot control roll, pitch, yaw and thrust independently, or "" if they can."""
        ...

    def allocation(self, actuators: Sequence[Mapping[str, Any]]) -> Array:
        """Return the control allocation: weights of roll, pitch and yaw torque per actuator (R, 3).

        It is normalised as in PX4.
        """
        ...

    def dynamics(self, profiles: Sequence[Profile], *, step_s: float) -> Dynamics:
        """Return the dynamics of vehicles of this class.

        profiles: profiles of the vehicles
        step_s: physics step [s]
        """
        ...
