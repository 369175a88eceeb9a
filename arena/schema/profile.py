"""The model of a vehicle's profile: mass, rotors, thrust, sensors. Profiles are files in `profiles/`."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field

from arena.constants import GRAVITY_M_S2
from arena.schema.base import NotNegative, Positive, PositiveVector, Strict, Vector
from arena.thrust_curve import ThrustCurve, thrust_curve


class Rotor(Strict):
    """A rotor, in PX4's motor order."""

    position_m: Vector
    """Position [m] [FRD], from the body origin."""
    direction: Literal["cw", "ccw"]
    """Direction of rotation seen from above; the reaction torque on the body is opposite."""


class QuadraticCurve(Strict):
    """Total thrust T = a u^2 + b u [N]."""

    kind: Literal["quadratic"]
    a: Positive
    b: NotNegative
    fade_speed_m_s: Positive | None = None
    """At airspeed v the rotors give the share 1 - v / fade_speed of it [m/s]."""


class TangentCurve(Strict):
    """Command u = (tan((T - offset) / scale) + phase) / gain for a total thrust T [N]; a line from the origin below low_u."""

    kind: Literal["tangent"]
    offset_n: float
    scale_n: Positive
    phase: float
    gain: Positive
    low_u: Annotated[float, Field(gt=0, lt=1)]
    fade_speed_m_s: Positive | None = None


class Imu(Strict):
    """Inertial measurement unit: noise rms per axis at 250 Hz; biases are drawn once per flight."""

    accel_noise_m_s2: NotNegative
    accel_bias_m_s2: NotNegative
    gyro_noise_rad_s: NotNegative
    gyro_bias_rad_s: NotNegative


class Baro(Strict):
    """Barometer."""

    noise_m: NotNegative


class Mag(Strict):
    """Magnetometer, rms per axis."""

    noise_gauss: NotNegative


class Gps(Strict):
    """Satellite receiver, rms per axis."""

    horizontal_noise_m: NotNegative
    vertical_noise_m: NotNegative
    velocity_noise_m_s: NotNegative
    rate_hz: Positive


class Sensors(Strict):
    """The sensors that the vehicle carries, by their names in `arena.sim.sensors.SENSORS`."""

    imu: Imu
    baro: Baro
    mag: Mag
    gps: Gps


class GroundEffect(Strict):
    """More thrust near the floor, by the method of images."""

    rotor_radius_m: Positive
    body_lift: NotNegative = 2.0
    """Lift of the fountain between the rotors [-]."""


class Battery(Strict):
    """Battery: a voltage that drops with the charge and with the current through a resistance."""

    cells: Annotated[int, Field(ge=1, le=14)]
    capacity_mah: Positive
    full_cell_v: Positive
    empty_cell_v: Positive
    resistance_ohm: NotNegative
    idle_a: NotNegative
    hover_a: Positive
    thrust_at_v: Positive | None = None
    """Voltage at which the thrust curve holds [V]; without it thrust does not depend on the voltage."""


class Profile(Strict):
    """A vehicle type."""

    name: str
    vehicle_class: Literal["multirotor"] = "multirotor"
    """Model of its dynamics, a row of `arena.vehicle_models.VEHICLE_MODELS`."""
    mass_kg: Positive
    inertia_kg_m2: PositiveVector
    """Principal moments Ixx, Iyy, Izz [kg m2] about the body axes."""
    radius_m: Positive
    """From the origin to the farthest point, horizontally [m]."""
    height_m: Positive
    ground_clearance_m: Positive
    """Body origin above the vehicle's lowest point [m]."""
    num_rotors: Annotated[int, Field(ge=3, le=8)]
    rotors: tuple[Rotor, ...]
    moment_ratio_m: Positive
    """Reaction torque per thrust [m]."""
    motor_up_s: Positive
    motor_down_s: Positive
    thrust_curve: Annotated[QuadraticCurve | TangentCurve, Field(discriminator="kind")]
    drag_kg_s: tuple[NotNegative, NotNegative, NotNegative]
    """Drag of the rotors at hover: force per airspeed along x, y, z [N s/m] [FRD]."""
    body_drag_kg_m: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Drag of the body: force per square of the airspeed along x, y, z [N s2/m2] [FRD]."""
    ground_effect: GroundEffect | None = None
    sensors: Sensors
    battery: Battery
    params: dict[str, float] = Field(default_factory=dict)
    """PX4 parameters of this airframe."""

    @property
    def curve(self) -> ThrustCurve:
        return thrust_curve(self.thrust_curve.model_dump())

    @property
    def hover_command(self) -> float:
        """The command u at which the static thrust carries the vehicle [-]: PX4's MPC_THR_HOVER."""
        return round(float(self.curve.command(self.mass_kg * GRAVITY_M_S2)), 4)

    def problems(self) -> list[str]:
        """Return what is wrong between several fields, a sentence each."""
        found = []
        if len(self.rotors) != self.num_rotors:
            found.append(f"num_rotors: got {self.num_rotors}, but {len(self.rotors)} rotors are listed")
        if not math.isfinite(most := self.curve.max_newtons) or most <= self.mass_kg * GRAVITY_M_S2:
            found.append(f"thrust_curve: gives {most:.1f} N at most, which does not lift {self.mass_kg} kg")
        return found

    def slice(self) -> dict[str, Any]:
        """Return the profile as JSON for the slices."""
        return self.model_dump(mode="json")
