"""Groups of data that a user program reads: `uav.ekf.pos`, `uav.sen.imu.acc_body`, ...

Each access returns the newest values; the values of one access come from one message. Old values raise
StaleDataError. `uav.snapshot()` returns the same groups with the values of one instant.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from arena.errors import RunError
from arena.geometry import Array, euler_from_quat, quat_conj, quat_rotate
from arena.uav.data_source import Body, Source
from arena.uav.relative_sensors import Beacons, EmulatedSensor, Neighbours
from arena.wire.telemetry_values import Attitude, Baro, Imu, Local


class Ekf:
    """The autopilot's state estimate."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def _local(self) -> Local:
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.local, "estimated position")

    def _attitude(self) -> Attitude:
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.attitude, "estimated attitude")

    @property
    def age_s(self) -> float:
        """Age of the position or the attitude [s], whichever is older. It is infinite before both have arrived."""
        self._source.refresh()
        return max(
            self._source.age(self._source.telemetry.local), self._source.age(self._source.telemetry.attitude)
        )

    @property
    def pos(self) -> Array:
        """Position of the body origin [m] [NED] (3,)."""
        return self._local().pos.copy()

    @property
    def vel(self) -> Array:
        """Velocity [m/s] [NED] (3,)."""
        return self._local().vel.copy()

    @property
    def vel_body(self) -> Array:
        """Velocity in body axes [m/s] [FRD] (3,)."""
        return quat_rotate(quat_conj(self._attitude().q_nb), self._local().vel)

    @property
    def att_q(self) -> Array:
        """Attitude q_nb [-] wxyz (4,)."""
        return self._attitude().q_nb.copy()

    @property
    def att_euler(self) -> Array:
        """Roll, pitch, yaw [rad] (3,)."""
        return euler_from_quat(self._attitude().q_nb)

    @property
    def ang_vel(self) -> Array:
        """Body rates [rad/s] [FRD] (3,)."""
        return self._attitude().ang_vel.copy()


class ImuSensor:
    """Measurements of the autopilot's inertial sensors."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def _imu(self) -> Imu:
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.imu, "inertial measurement")

    @property
    def age_s(self) -> float:
        self._source.refresh()
        return self._source.age(self._source.telemetry.imu)

    @property
    def acc_body(self) -> Array:
        """Specific force [m/s2] [FRD] (3,). It is about (0, 0, -9.81) at rest."""
        return self._imu().acc_body.copy()

    @property
    def ang_vel(self) -> Array:
        """Body rates as measured [rad/s] [FRD] (3,)."""
        return self._imu().ang_vel.copy()

    @property
    def mag(self) -> Array:
        """Magnetic field [T] [FRD] (3,)."""
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.mag, "magnetic field").mag.copy()


class MocapSensor:
    """The vehicle's pose as measured by motion capture, independent of the autopilot."""

    def __init__(self, source: Source) -> None:
        self._source = source

    @property
    def age_s(self) -> float:
        self._source.refresh()
        return self._source.age(self._source.poses.own)

    @property
    def pos(self) -> Array:
        """Position of the body origin [m] [NED] (3,)."""
        self._source.refresh()
        return self._source.fresh(self._source.poses.own, "motion capture pose").p_n

    @property
    def att_q(self) -> Array:
        """Attitude q_nb [-] wxyz (4,)."""
        self._source.refresh()
        return self._source.fresh(self._source.poses.own, "motion capture pose").q_nb

    @property
    def att_euler(self) -> Array:
        """Roll, pitch, yaw [rad] (3,)."""
        return euler_from_quat(self.att_q)


class GpsSensor:
    """Measurements of the autopilot's satellite receiver, if it has one."""

    def __init__(self, source: Source) -> None:
        self._source = source

    @property
    def age_s(self) -> float:
        self._source.refresh()
        return self._source.age(self._source.telemetry.gps)

    @property
    def pos(self) -> Array:
        """Latitude [deg], longitude [deg], altitude above mean sea level [m] (3,)."""
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.gps, "gps").pos.copy()


class BaroSensor:
    """Measurements of the autopilot's barometer."""

    def __init__(self, source: Source) -> None:
        self._source = source

    def _baro(self) -> Baro:
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.baro, "air pressure")

    @property
    def age_s(self) -> float:
        self._source.refresh()
        return self._source.age(self._source.telemetry.baro)

    @property
    def pressure(self) -> float:
        """Air pressure [Pa]."""
        return self._baro().pressure

    @property
    def temperature(self) -> float:
        """Air temperature [deg C]."""
        return self._baro().temperature

    @property
    def alt(self) -> float:
        """Pressure altitude [m]."""
        return self._baro().alt


@dataclass(frozen=True)
class Sensors:
    """All sensors of the vehicle, `uav.sen`."""

    source: Source = field(repr=False)
    imu: ImuSensor = field(init=False, repr=False)
    mocap: MocapSensor = field(init=False, repr=False)
    gps: GpsSensor = field(init=False, repr=False)
    baro: BaroSensor = field(init=False, repr=False)
    emu: EmulatedSensor = field(init=False, repr=False)
    neighbours: Neighbours = field(init=False, repr=False)
    beacons: Beacons = field(init=False, repr=False)

    def __post_init__(self) -> None:
        kinds = {
            "imu": ImuSensor,
            "mocap": MocapSensor,
            "gps": GpsSensor,
            "baro": BaroSensor,
            "emu": EmulatedSensor,
            "neighbours": Neighbours,
            "beacons": Beacons,
        }
        for name, kind in kinds.items():
            object.__setattr__(self, name, kind(self.source))


class Actuation:
    """Actuator outputs of the autopilot, `uav.act`."""

    def __init__(self, source: Source, num_rotors: int) -> None:
        self._source, self._rotors = source, num_rotors

    @property
    def age_s(self) -> float:
        self._source.refresh()
        return self._source.age(self._source.telemetry.actuators)

    @property
    def group(self) -> int:
        """Group number of the actuator outputs, as the autopilot reports it.

        It is the mixer group of ACTUATOR_CONTROL_TARGET, or the port number of SERVO_OUTPUT_RAW.
        """
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.actuators, "actuators").group

    @property
    def output(self) -> Array:
        """Output of each rotor, 0..1 [-] (num_rotors,)."""
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.actuators, "actuators").output[: self._rotors].copy()


class Info:
    """Identity and state of the vehicle, `uav.info`."""

    def __init__(self, source: Source, body: Body) -> None:
        self._source = source
        self.drone_ns, self.mass, self.radius, self.height = body.ns, body.mass, body.radius, body.height
        self.num_rotors, self.thrust_curve = body.num_rotors, body.thrust_curve

    @property
    def age_s(self) -> float:
        """Age of the last heartbeat [s]."""
        self._source.refresh()
        return self._source.age(self._source.telemetry.heartbeat)

    @property
    def flight_mode(self) -> str:
        """Flight mode with PX4's name, such as "OFFBOARD" or "AUTO.LAND"."""
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.heartbeat, "heartbeat").mode

    @property
    def is_connected(self) -> bool:
        """True while heartbeats of the autopilot arrive. Never raises an error."""
        try:
            return self.age_s <= self._source.limit_s("connection")
        except RunError:  # the world has ended, or the last data could not be read
            return False

    @property
    def is_armed(self) -> bool:
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.heartbeat, "heartbeat").armed

    @property
    def is_landed(self) -> bool:
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.ground, "landed state").landed

    @property
    def battery(self) -> float:
        """Remaining charge [%], or NaN if the autopilot does not measure it."""
        self._source.refresh()
        return self._source.fresh(self._source.telemetry.status, "battery").battery


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """All data groups of a vehicle at one instant, as `UAV.snapshot` returns them."""

    ekf: Ekf
    sen: Sensors
    act: Actuation
    info: Info

    @classmethod
    def of(cls, source: Source, body: Body) -> Snapshot:
        """Create the data groups, which read their values from `source`.

        body: constants of the vehicle.
        """
        return cls(
            ekf=Ekf(source),
            sen=Sensors(source),
            act=Actuation(source, body.num_rotors),
            info=Info(source, body),
        )
