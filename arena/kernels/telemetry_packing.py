"""Telemetry of the built-in autopilots: computes the values of a vehicle, and packs them into MAVLink frames.

A quantity is one or several numbers, such as the position (`telemetry_quantities`). The tables of a message say which quantity
its fields contain. They are made from pymavlink's dialect (`arena.autopilot.mavlink.packed_messages`), so no layout is in this
module. Quantities that no message of a datagram contains are not computed.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from arena.kernels import (
    estimate_validity,
    global_coordinates,
    limits,
    payload_writer,
    rotations,
    standard_atmosphere,
)
from arena.kernels.arrays import array, floats
from arena.kernels.telemetry_quantities import BITS, COLUMNS, RARE_INPUTS, STATUS_INPUTS, VALUES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from arena.kernels.arrays import Flags, Floats, Integers
    from arena.kernels.payload_writer import PayloadWriter

_TIME_MS, _TIME_US = COLUMNS["time_ms"], COLUMNS["time_us"]
_TIME_US_32, _TIME_US_HIGH = COLUMNS["time_us_32"], COLUMNS["time_us_high"]
_TIME_NS, _UNIX_US = COLUMNS["time_ns"], COLUMNS["unix_us"]
_RPY, _Q = COLUMNS["rpy"], COLUMNS["q_nb"]
_OMEGA, _P = COLUMNS["omega_b"], COLUMNS["p_n"]
_V = COLUMNS["v_n"]
_POSE_COVARIANCE, _VELOCITY_COVARIANCE = COLUMNS["pose_covariance"], COLUMNS["velocity_covariance"]
_RESETS, _ACCEL = COLUMNS["reset_counter"], COLUMNS["accel_b"]
_GYRO, _MAG = COLUMNS["gyro_b"], COLUMNS["mag_b"]
_PRESSURE, _BARO_ALT = COLUMNS["pressure_hpa"], COLUMNS["baro_alt"]
_LAT, _LON = COLUMNS["lat"], COLUMNS["lon"]
_ALT_MM, _RELATIVE_MM = COLUMNS["alt_mm"], COLUMNS["relative_alt_mm"]
_VELOCITY_CM_S, _HEADING_CDEG, _SPEED = COLUMNS["velocity_cm_s"], COLUMNS["heading_cdeg"], COLUMNS["speed"]
_ALT, _CLIMB = COLUMNS["alt"], COLUMNS["climb"]
_HEADING_DEG, _THROTTLE = COLUMNS["heading_deg"], COLUMNS["throttle"]
_HEIGHTS, _Q_SP = COLUMNS["heights"], COLUMNS["q_sp"]
_OMEGA_SP, _THRUST = COLUMNS["omega_sp"], COLUMNS["thrust"]
_SETPOINT, _IGNORED, _SERVOS = COLUMNS["setpoint"], COLUMNS["ignored"], COLUMNS["servos"]
_VOLTAGE, _CURRENT, _REMAINING = COLUMNS["voltage_mv"], COLUMNS["current_ca"], COLUMNS["remaining"]
_STATUS, _ARMED = COLUMNS["mav_type"], COLUMNS["armed"]
_LAT0, _LON0 = COLUMNS["lat0"], COLUMNS["lon0"]
_ALT0, _HEADING, _HOME_D = COLUMNS["alt0"], COLUMNS["heading"], COLUMNS["home_d"]
_PRESENT, _PRESENT_LOST = COLUMNS["present"], COLUMNS["present_lost"]
_HEALTH, _HEALTH_LOST = COLUMNS["health"], COLUMNS["health_lost"]
_ESC_COUNTER, _ESC_FIRST = COLUMNS["esc_counter"], COLUMNS["esc_first"]
_ESC_COUNT, _ESC_ONLINE = COLUMNS["esc_count"], COLUMNS["esc_online"]
_ESC_RPM, _ESC_VOLTAGE, _ESC_CURRENT = COLUMNS["esc_rpm"], COLUMNS["esc_voltage"], COLUMNS["esc_current"]
_PING_NUMBER, _CHARGE_STATE, _CONSUMED = COLUMNS["ping"], COLUMNS["charge_state"], COLUMNS["consumed_mah"]
_ESTIMATOR_FLAGS, _RATIOS = COLUMNS["estimator_flags"], COLUMNS["ratio_position"]
_ACCURACIES, _MODES, _ALIGNED = COLUMNS["accuracies"], COLUMNS["intended_mode"], COLUMNS["aligned"]
_BAT_LOW = COLUMNS["bat_low"]
_ANGLES, _COVARIANCE, _SENSORS, _POWER = BITS["angles"], BITS["covariance"], BITS["sensors"], BITS["power"]
_ALTITUDES, _GLOBAL, _SETPOINTS = BITS["heights"], BITS["global"], BITS["setpoints"]
_ESC, _PING, _RARE = BITS["escs"], BITS["ping"], BITS["rare"]
_STATUS_INPUTS, _RARE_INPUTS = len(STATUS_INPUTS), len(RARE_INPUTS)
_HEAD = payload_writer.HEAD
_ESCS = 4  # in one message
_FULL_SPEED_RPM = 6000.0  # at motor command 1; PX4 SITL reports the same, because no rotor speed is simulated
_POSITION = 3  # level of a setpoint, as in `cascade`
_DEG = 180.0 / math.pi
_NAN = float("nan")
_MOST_FLOAT32 = 3.4e38  # an infinite test ratio is sent as a number
_CHARGE_OK = 1.0  # MAV_BATTERY_CHARGE_STATE; LOW, CRITICAL and EMERGENCY follow
_MOST_DATAGRAM = 16384  # bytes of all messages of a vehicle, with many ESCs


class TelemetryPacking:
    """Packs the telemetry of V vehicles with at most R rotors each.

    inputs, rare_inputs: input: values of `STATUS_INPUTS` (V, 15) and of `RARE_INPUTS` (V, 13)
    mag_b: input: magnetic field [gauss] [FRD] (V, 3)
    baro_alt: input: barometric altitude [m] (V,)
    battery_v, battery_a, battery: input: voltage [V], current [A] and remaining charge 0..1 (V,)
    consumed_mah: input: consumed charge [mAh] (V,)
    thrust, motors: input: collective thrust (V,) and motor commands (V, R) 0..1
    rotors: R
    pings: number of the last PING of each link (L,)
    escs: input: number of ESCs, one for each rotor (V,)
    values: the quantities of one vehicle, then the constants of the messages. Only the groups that the newest datagram contains
        are of its vehicle
    """

    def __init__(
        self,
        thrust: Floats,
        motors: Floats,
        consumed_mah: Floats,
        pings: Integers,
        constants: Sequence[float],
        writers: Sequence[PayloadWriter],
        earth_m: float,
        boot_unix_us: float,
    ) -> None:
        """Create the packer, with arrays for all vehicles and messages.

        constants: constant values of all messages
        writers: one for each message
        earth_m: radius of the Earth [m]
        boot_unix_us: Unix time of the boot [us]
        """
        self.writers, self.earth_m = {each.number: each for each in writers}, earth_m
        self.boot_unix_us, self.consumed_mah, self.pings = boot_unix_us, consumed_mah, pings
        vehicles = len(thrust)
        self.values = floats(VALUES + len(constants))
        for k, constant in enumerate(constants):
            self.values[VALUES + k] = constant
        for k in range(21):
            self.values[_POSE_COVARIANCE + k] = self.values[_VELOCITY_COVARIANCE + k] = _NAN
        self.inputs = floats(vehicles, len(STATUS_INPUTS))
        self.rare_inputs = floats(vehicles, len(RARE_INPUTS))
        self.mag_b = floats(vehicles, 3)
        self.baro_alt = floats(vehicles)
        self.battery_v, self.battery_a, self.battery = floats(vehicles), floats(vehicles), floats(vehicles)
        self.thrust, self.motors, self.rotors = thrust, motors, array(motors).shape[1]
        self.escs = floats(vehicles)
        self._bytes = self._datagram = memoryview(bytearray(_MOST_DATAGRAM))
        self._end, self._begins = 0, dict[int, memoryview]()

    def read_estimates_from(
        self,
        accel_b: Floats,
        gyro_b: Floats,
        p_n: Floats,
        v_n: Floats,
        q_nb: Floats,
        r_nb: Floats,
        omega_b: Floats,
        cov: Floats,
        resets: Integers,
        xy_valid: Flags,
    ) -> None:
        """Store the estimator's arrays, from which `pack` reads position, attitude and other estimates.

        accel_b, gyro_b: measured specific force [m/s2] and body rates [rad/s] [FRD] (V, 3)
        xy_valid: True for a valid horizontal position (V,)
        """
        self.accel_b, self.gyro_b = accel_b, gyro_b
        self.p_n, self.v_n, self.q_nb, self.r_nb, self.omega_b = p_n, v_n, q_nb, r_nb, omega_b
        self.cov, self.resets, self.xy_valid = cov, resets, xy_valid

    def read_validity_from(self, z_valid: Flags, test_ratio: Floats) -> None:
        """Store more of the estimator's arrays, which only rare messages contain.

        z_valid: True for a valid height (V,)
        test_ratio: squared innovation divided by its gate, for position and yaw [-] (V, 2)
        """
        self.z_valid, self.test_ratio = z_valid, test_ratio

    def read_setpoints_from(
        self,
        level: Integers,
        p_n: Floats,
        yaw: Floats,
        yaw_rate: Floats,
        v_sp_n: Floats,
        a_sp_n: Floats,
        q_sp: Floats,
        omega_sp: Floats,
    ) -> None:
        """Store the arrays from which `pack` reads setpoints and the outputs of the controllers."""
        self.level, self.sp_p_n, self.sp_yaw, self.sp_yaw_rate = level, p_n, yaw, yaw_rate
        self.v_sp_n, self.a_sp_n, self.q_sp, self.omega_sp = v_sp_n, a_sp_n, q_sp, omega_sp

    def set_time(self, time_ms: float, time_us: float, time_ns: float) -> None:
        """Set the time that the next messages contain.

        time_ms: time since boot [ms], modulo 2^32
        time_us, time_ns: time since boot [us], [ns]
        """
        self.values[_TIME_MS], self.values[_TIME_US], self.values[_TIME_NS] = time_ms, time_us, time_ns
        low = time_us % 4294967296.0
        self.values[_TIME_US_32], self.values[_TIME_US_HIGH] = low, (time_us - low) / 4294967296.0
        self.values[_UNIX_US] = self.boot_unix_us + time_us
        self.values[_ESC_COUNTER] = (
            global_coordinates.rounded(time_ns * 1e-8) % 65536.0
        )  # ten messages a second

    def frame_count(self, i: int, message_ids: list[int]) -> int:
        """Return how many MAVLink frames `pack` makes of the given messages of vehicle i."""
        count = 0
        for number in message_ids:
            count += self._parts(i, self.writers[number])
        return count

    def pack(self, i: int, message_ids: list[int], link: int, seq: int, sysid: int, compid: int) -> bytes:
        """Encode the given messages of vehicle i as MAVLink frames, and return them as one datagram.

        link: index of the link in `pings`, which numbers the PINGs
        seq: sequence number of the first frame; the other frames have the next ones
        sysid, compid: sender
        """
        needs, writers = 0, [self.writers[number] for number in message_ids]
        for writer in writers:
            needs |= writer.needs
        self.begin(i, needs)
        for writer in writers:
            seq = self.append(i, writer, link, seq, sysid, compid)
        return self.datagram()

    def begin(self, i: int, needs: int) -> None:
        """Begin a datagram of vehicle i, and compute the values that its messages contain.

        needs: set of groups of quantities, one bit each (`BITS`), which contains `needs` of all writers of the datagram
        """
        self._end = 0
        self._compute_common(i)
        if needs & _ANGLES:
            self._compute_angles(i)
        if needs & _COVARIANCE:
            self._compute_covariance(i)
        if needs & _SENSORS:
            self._compute_sensors(i)
        if needs & _POWER:
            self._compute_power(i)
        if needs & _ALTITUDES:
            self._compute_heights(i)
        if needs & _GLOBAL:
            self._compute_global(i)
        if needs & _SETPOINTS:
            self._compute_setpoints(i)
        if needs & _RARE:
            self._compute_rare(i)

    def append(self, i: int, writer: PayloadWriter, link: int, seq: int, sysid: int, compid: int) -> int:
        """Append a message of vehicle i to the datagram that `begin` began. Return the sequence number of the next frame.

        link, seq, sysid, compid: as for `pack`
        """
        if writer.needs & _PING:
            self.pings[link] += 1
            self.values[_PING_NUMBER] = self.pings[link]
        for part in range(self._parts(i, writer)):
            if writer.needs & _ESC:
                self._compute_escs(i, part * _ESCS)
            size = writer.write(self.values, seq, sysid, compid)
            for k in range(size):
                self._datagram[self._end + k] = writer.frame[_HEAD + k]
            self._end += size
            seq = (seq + 1) % 256
        return seq

    def datagram(self) -> bytes:
        """Return the messages that were appended since `begin`."""
        found = self._begins.get(self._end)
        if found is None:  # making a view takes longer than the copy
            found = self._begins[self._end] = self._bytes[: self._end]
        return found.tobytes()

    def _parts(self, i: int, writer: PayloadWriter) -> int:
        """Return how many frames vehicle i needs for a message: one per four ESCs for ESC messages, else one."""
        return int((self.escs[i] + (_ESCS - 1)) // _ESCS) if writer.needs & _ESC else 1

    def _compute_common(self, i: int) -> None:
        """Compute the values that most messages contain, or that the other functions use."""
        out = self.values
        for k in range(_STATUS_INPUTS):
            out[_STATUS + k] = self.inputs[i, k]
        if not self.xy_valid[i]:
            out[_PRESENT], out[_HEALTH] = out[_PRESENT_LOST], out[_HEALTH_LOST]
        for k in range(4):
            out[_Q + k] = self.q_nb[i, k]
        for k in range(3):
            out[_OMEGA + k], out[_P + k], out[_V + k] = self.omega_b[i, k], self.p_n[i, k], self.v_n[i, k]

    def _compute_rare(self, i: int) -> None:
        """Compute the values of vehicle i that only rare messages contain."""
        out = self.values
        for k in range(_RARE_INPUTS):
            out[_MODES + k] = self.rare_inputs[i, k]
        out[_CONSUMED], state = self.consumed_mah[i], _CHARGE_OK
        for k in range(3):
            if self.battery[i] <= out[_BAT_LOW + k]:
                state += 1.0
        out[_CHARGE_STATE] = state
        out[_ESTIMATOR_FLAGS] = estimate_validity.status_flags(
            out[_ALIGNED] != 0.0, self.xy_valid[i] != 0, self.z_valid[i] != 0, not math.isnan(out[_ALT0])
        )
        for k in range(2):
            out[_RATIOS + k] = limits.within(self.test_ratio[i, k], 0.0, _MOST_FLOAT32)
        out[_ACCURACIES] = math.sqrt(self.cov[i, 0, 0] + self.cov[i, 1, 1])
        out[_ACCURACIES + 1] = math.sqrt(self.cov[i, 2, 2])

    def _compute_angles(self, i: int) -> None:
        out, r = self.values, self.r_nb
        out[_RPY] = math.atan2(r[i, 2, 1], r[i, 2, 2])
        out[_RPY + 1] = math.asin(limits.within(-r[i, 2, 0], -1.0, 1.0))
        out[_RPY + 2] = math.atan2(r[i, 1, 0], r[i, 0, 0])
        out[_HEADING_DEG] = (_DEG * (out[_RPY + 2] + out[_HEADING])) % 360.0
        out[_HEADING_CDEG] = out[_HEADING_DEG] * 100.0

    def _compute_covariance(self, i: int) -> None:
        out = self.values
        at = 0  # position of a diagonal element in the row-major upper triangle
        for k in range(6):
            out[_POSE_COVARIANCE + at] = self.cov[i, k if k < 3 else k + 3, k if k < 3 else k + 3]
            if k < 3:
                out[_VELOCITY_COVARIANCE + at] = self.cov[i, k + 3, k + 3]
            at += 6 - k
        out[_RESETS] = self.resets[i] % 256

    def _compute_sensors(self, i: int) -> None:
        out = self.values
        for k in range(3):
            out[_ACCEL + k], out[_GYRO + k], out[_MAG + k] = (
                self.accel_b[i, k],
                self.gyro_b[i, k],
                self.mag_b[i, k],
            )
        out[_PRESSURE] = standard_atmosphere.pressure_hpa(self.baro_alt[i])
        out[_BARO_ALT] = self.baro_alt[i]

    def _compute_power(self, i: int) -> None:
        out = self.values
        out[_VOLTAGE] = limits.within(self.battery_v[i] * 1e3, 0.0, 65534.0)
        out[_CURRENT], out[_REMAINING] = (
            self.battery_a[i] * 100.0,
            global_coordinates.rounded(100.0 * self.battery[i]),
        )
        for k in range(8):
            out[_SERVOS + k] = 900.0
            if k < self.rotors and out[_ARMED] != 0.0:
                out[_SERVOS + k] = 1000.0 + 1000.0 * self.motors[i, k]

    def _compute_escs(self, i: int, first: int) -> None:
        """Compute the values of four ESCs. The battery current is split in proportion to the motor commands.

        first: number of the first ESC
        """
        out, count, total = self.values, self.escs[i], 0.0
        for k in range(int(count)):
            total += self.motors[i, k]
        amperes = self.battery_a[i] if math.isfinite(self.battery_a[i]) else 0.0
        out[_ESC_FIRST], out[_ESC_COUNT], out[_ESC_ONLINE] = first, count, (2.0**count - 1.0) % 256.0
        for k in range(_ESCS):
            exists = first + k < count
            command = self.motors[i, first + k] if exists else 0.0
            out[_ESC_RPM + k] = _FULL_SPEED_RPM * command
            out[_ESC_VOLTAGE + k] = self.battery_v[i] if exists else 0.0
            out[_ESC_CURRENT + k] = amperes * command / total if total > 0.0 else 0.0

    def _compute_heights(self, i: int) -> None:
        out = self.values
        up = -out[_P + 2]
        out[_HEIGHTS], out[_HEIGHTS + 1] = self.baro_alt[i], up + out[_ALT0]
        out[_HEIGHTS + 2], out[_HEIGHTS + 3] = up, up + out[_HOME_D]
        out[_ALT] = up if math.isnan(out[_ALT0]) else up + out[_ALT0]
        out[_SPEED], out[_CLIMB] = limits.length(out[_V], out[_V + 1]), -out[_V + 2]
        out[_THROTTLE] = 100.0 * self.thrust[i]

    def _compute_global(self, i: int) -> None:
        """Compute the global position and velocity; NaN if the vehicle has no origin (latitude, longitude)."""
        out, heading = self.values, self.values[_HEADING]
        out[_LAT], out[_LON] = global_coordinates.global_position(
            out[_P], out[_P + 1], heading, out[_LAT0], out[_LON0], self.earth_m
        )
        home_d = 0.0 if math.isnan(out[_HOME_D]) else out[_HOME_D]
        out[_ALT_MM] = (out[_ALT0] - out[_P + 2]) * 1e3
        out[_RELATIVE_MM] = (home_d - out[_P + 2]) * 1e3
        cos, sin = math.cos(heading), math.sin(heading)
        out[_VELOCITY_CM_S] = (cos * out[_V] - sin * out[_V + 1]) * 100.0
        out[_VELOCITY_CM_S + 1] = (sin * out[_V] + cos * out[_V + 1]) * 100.0
        out[_VELOCITY_CM_S + 2] = out[_V + 2] * 100.0

    def _compute_setpoints(self, i: int) -> None:
        """Compute the setpoints that the controllers follow; NaN for values that are not controlled."""
        out, by_position = self.values, self.level[i] == _POSITION
        for k in range(4):
            out[_Q_SP + k] = self.q_sp[i, k]
        out[_THRUST] = self.thrust[i]
        for k in range(3):
            out[_OMEGA_SP + k], out[_SETPOINT + k] = self.omega_sp[i, k], self.sp_p_n[i, k]
            out[_SETPOINT + 3 + k] = self.v_sp_n[i, k] if by_position else _NAN
            out[_SETPOINT + 6 + k] = self.a_sp_n[i, k] if by_position else _NAN
        out[_SETPOINT + 9] = self.sp_yaw[i]
        if by_position and math.isnan(self.sp_yaw[i]):  # report the heading that is held
            out[_SETPOINT + 9] = rotations.yaw(
                (self.q_sp[i, 0], self.q_sp[i, 1], self.q_sp[i, 2], self.q_sp[i, 3])
            )
        out[_SETPOINT + 10] = self.sp_yaw_rate[i]
        ignored, bit = 0.0, 1.0  # POSITION_TARGET_TYPEMASK of p, v, a, yaw, yaw rate
        for k in range(11):
            if k == 9:
                bit *= 2.0  # FORCE_SET, unused
            if not math.isfinite(out[_SETPOINT + k]):
                ignored += bit
            bit *= 2.0
        out[_IGNORED] = ignored
