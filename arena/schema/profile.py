"""The pydantic model of a vehicle profile: mass, rotors, thrust curve, sensors.

Each file in `profiles/` is one profile.
"""

import math
from typing import Annotated, Any, Literal

from pydantic import Field

from arena.constants import GRAVITY_M_S2
from arena.schema.base import NotNegative, Positive, PositiveVector, Strict, Vector
from arena.thrust_curve import ThrustCurve, thrust_curve


class Rotor(Strict):
    """A rotor. A profile lists its rotors in PX4's motor order."""

    position_m: Vector
    """Position [m] [FRD], from the body origin."""
    direction: Literal["cw", "ccw"]
    """Direction of rotation seen from above; the reaction torque on the body is opposite."""


class QuadraticCurve(Strict):
    """Thrust curve T = a u^2 + b u: total thrust T [N] of a motor command u from 0 to 1."""

    kind: Literal["quadratic"]
    a: Positive
    b: NotNegative
    fade_speed_m_s: Positive | None = None
    """Loss of thrust with airspeed [m/s]: at airspeed v the thrust is (1 - v / fade_speed) T. None: no loss."""


class TangentCurve(Strict):
    """Thrust curve u = (tan((T - offset) / scale) + phase) / gain: motor command u for a total thrust T [N].

    Below the command low_u, the curve is a straight line from the origin.
    """

    kind: Literal["tangent"]
    offset_n: float
    scale_n: Positive
    phase: float
    gain: Positive
    low_u: Annotated[float, Field(gt=0, lt=1)]
    fade_speed_m_s: Positive | None = None


class Imu(Strict):
    """Inertial measurement unit (IMU). Noise and bias are rms values per axis. The bias is random.

    The noise is that of one sample at 250 Hz. At another `sim.sensor_hz`, arena keeps the noise density (this value divided by
    the square root of 250 Hz).
    """

    accel_noise_m_s2: NotNegative
    accel_bias_m_s2: NotNegative
    gyro_noise_rad_s: NotNegative
    gyro_bias_rad_s: NotNegative
    accel_bias_walk_m_s2_per_sqrt_s: NotNegative = 0.0
    """Random walk of the bias: rms change per axis after 1 s; it grows with the square root of the time."""
    gyro_bias_walk_rad_s_per_sqrt_s: NotNegative = 0.0
    accel_vibration_m_s2: NotNegative = 0.0
    """Vibration in hover: rms of a sine per axis. It grows with the square of the rotor speed, as the force of an imbalance does."""
    gyro_vibration_rad_s: NotNegative = 0.0
    vibration_hz: NotNegative = 100.0
    """Frequency of the vibration in hover [Hz]: revolutions of a rotor per second."""


class Baro(Strict):
    """Barometer with the rms noise of the height [m] at 250 Hz.

    At other rates the noise density stays the same.
    """

    noise_m: NotNegative


class Mag(Strict):
    """Magnetometer with the rms noise per axis at 250 Hz.

    At other rates the noise density stays the same.
    """

    noise_gauss: NotNegative


class Gps(Strict):
    """GPS receiver with rms noise per axis and rate of the fixes."""

    horizontal_noise_m: NotNegative
    vertical_noise_m: NotNegative
    velocity_noise_m_s: NotNegative
    rate_hz: Positive


class Sensors(Strict):
    """Sensors of the vehicle. The keys are the names in `arena.sim.sensors.SENSORS`."""

    imu: Imu
    baro: Baro
    mag: Mag
    gps: Gps


class GroundEffect(Strict):
    """Ground effect, which increases the thrust near the floor (method of images)."""

    rotor_radius_m: Positive
    body_lift: NotNegative = 2.0
    """Lift coefficient of the upwash (fountain effect) between the rotors [-]."""


class Downwash(Strict):
    """Downwash: wind that this vehicle causes at vehicles below it (turbulent jet model)."""

    rotor_radius_m: Positive
    strength: NotNegative = 1.0
    """Factor of the air speed [-]. 0: this vehicle makes no downwash."""


class RotorInertia(Strict):
    """Moment of inertia of one rotor with its propeller.

    When the rotor gains speed, the motor's reaction torque turns the body the other way.
    """

    moment_kg_m2: NotNegative
    """Moment of inertia of rotor and propeller about the rotor's axis [kg m2]. 0: no torque."""
    thrust_n_s2: Positive
    """Thrust of one rotor divided by the square of its speed [N s2/rad2]."""


class Battery(Strict):
    """Battery model. The voltage falls with the charge, and with the current through the internal resistance."""

    cells: Annotated[int, Field(ge=1, le=14)]
    capacity_mah: Positive
    full_cell_v: Positive
    empty_cell_v: Positive
    resistance_ohm: NotNegative
    idle_a: NotNegative
    hover_a: Positive
    thrust_at_v: Positive | None = None
    """Battery voltage at which the thrust curve was measured [V]. None: thrust does not depend on the voltage."""


class Profile(Strict):
    """A vehicle type: its dynamics, sensors, battery and PX4 parameters."""

    name: str
    vehicle_class: Literal["multirotor"] = "multirotor"
    """Model of the dynamics: a key of `arena.vehicle_models.VEHICLE_MODELS`."""
    mass_kg: Positive
    inertia_kg_m2: PositiveVector
    """Principal moments Ixx, Iyy, Izz [kg m2] about the body axes."""
    radius_m: Positive
    """Horizontal distance from the body origin to the farthest point of the vehicle [m]."""
    height_m: Positive
    ground_clearance_m: Positive
    """Height of the body origin above the vehicle's lowest point [m]."""
    num_rotors: Annotated[int, Field(ge=3, le=8)]
    rotors: tuple[Rotor, ...]
    moment_ratio_m: Positive
    """Reaction torque of a rotor divided by its thrust [m]."""
    motor_up_s: Positive
    motor_down_s: Positive
    thrust_curve: Annotated[QuadraticCurve | TangentCurve, Field(discriminator="kind")]
    drag_kg_s: tuple[NotNegative, NotNegative, NotNegative]
    """Linear drag of the rotors at hover: force divided by airspeed, along x, y, z [N s/m] [FRD]."""
    body_drag_kg_m: tuple[NotNegative, NotNegative, NotNegative] = (0.0, 0.0, 0.0)
    """Quadratic drag of the body: force divided by the square of the airspeed, along x, y, z [N s2/m2] [FRD]."""
    ground_effect: GroundEffect | None = None
    downwash: Downwash | None = None
    rotor_inertia: RotorInertia | None = None
    sensors: Sensors
    battery: Battery
    params: dict[str, float] = Field(default_factory=dict)
    """PX4 parameters of this airframe."""

    @property
    def curve(self) -> ThrustCurve:
        return thrust_curve(self.thrust_curve.as_dict())

    @property
    def hover_command(self) -> float:
        """Motor command u (0 to 1) at which the static thrust equals the weight: PX4's MPC_THR_HOVER."""
        return round(self.curve.static_command(self.mass_kg * GRAVITY_M_S2), 4)

    @property
    def rotor_radius_m(self) -> float | None:
        """Propeller radius [m], from the profile's section `downwash` or `ground_effect`. None if neither exists."""
        given = self.downwash or self.ground_effect
        return None if given is None else given.rotor_radius_m

    def problems(self) -> list[str]:
        """Return one sentence for each inconsistency in the profile.

        Checked: `num_rotors` against the list of rotors, and full thrust against the weight.
        """
        found = []
        if len(self.rotors) != self.num_rotors:
            found.append(f"num_rotors: got {self.num_rotors}, but `rotors` lists {len(self.rotors)}")
        if not math.isfinite(most := self.curve.max_newtons) or most <= self.mass_kg * GRAVITY_M_S2:
            found.append(
                f"thrust_curve: the largest thrust is {most:.1f} N, which does not lift {self.mass_kg} kg"
            )
        return found

    def slice(self) -> dict[str, Any]:
        """Return the profile as a JSON object, for the configuration files (slices) of processes."""
        return self.as_dict(json=True)
