"""Fuzzed MAVLink against the built-in autopilot, in phases, and the conditions that must hold.

    powerless   every message; an empty battery prevents arming: the vehicle stays disarmed, its motors stopped
    ground      every message: the vehicle arms only after a command that arms; then it may fly
    hover       armed in HOLD, without messages that may move the vehicle: it keeps its position
    offboard    position setpoints of all kinds in OFFBOARD: tilt and speed stay within their limits, then it holds again
    wild        accelerations, attitudes and rates, which have no limits: the motor commands stay finite

Each vehicle has a neighbour that receives nothing: its flight equals that without the fuzzed messages, bit by bit.
"""

from __future__ import annotations

import math
import pickle
import struct
from collections import Counter
from dataclasses import dataclass, field
from random import Random
from typing import Any

import numpy as np
from flight import Flight
from fuzzing import KINDS, Fuzz, read, v2
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.vehicle import Vehicle
from arena.builtin_parameters import SPECS

LIMITS = {"MPC_XY_VEL_MAX": 3.0, "MPC_Z_VEL_MAX_UP": 2.0, "MPC_Z_VEL_MAX_DN": 1.5, "MPC_TILTMAX_AIR": 35.0}
WIDE = {"size_m": [2000.0, 2000.0, 400.0]}
STAYS_WITHIN_M = 0.25  # of the position in HOLD
TILT_DEG, SPEED, SPEED_D = 65.0, 4.5, 3.5  # LIMITS with overshoot
COMMANDS = ("COMMAND_LONG", "COMMAND_INT")
SETPOINTS = ("SET_POSITION_TARGET_LOCAL_NED", "SET_POSITION_TARGET_GLOBAL_INT")
FATAL = (
    mavlink.MAV_CMD_DO_FLIGHTTERMINATION,
    mavlink.MAV_CMD_INJECT_FAILURE,
    mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
)
SETTLED = 5  # steps until the motors follow the commander
HOLD, ARM = (176, 1, 4, 3), (400, 1)
CLIENT = (
    (HOLD, ARM, (22, 0, 0, 0, math.nan, math.nan, math.nan, 102.5)),
    (HOLD, ARM),
    (HOLD, ARM, (176, 1, 6)),
    (HOLD, ARM, (300,)),
)
NO_ACCELERATION = 0b111000000
ANSWERS = {"COMMAND_ACK": "result", "MISSION_ACK": "type"}


@dataclass
class Tally:
    """Numbers of sent, answered and refused messages, by name."""

    sent: Counter[str] = field(default_factory=Counter)
    answered: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)

    def __iadd__(self, other: Tally) -> Tally:
        self.sent += other.sent
        self.answered += other.answered
        self.refused += other.refused
        return self


class Noisy(Flight):
    """Flight of two vehicles; the first receives fuzzed messages, around its poses."""

    def __init__(
        self, *, seed: int, battery: float | None = None, params: dict[str, float] | None = None
    ) -> None:
        super().__init__(2, seed=3, params=params, **WIDE)
        self.fuzz = Fuzz(Random(seed))
        self.tally = Tally()
        self.batch: list[tuple[str, bytes]] = []
        self.client: tuple[Any, ...] = ()
        if battery is not None:
            self.battery = {0: battery, 1: battery}
        origin = [
            int(self.fuzz.origin[0] * 1e7),
            int(self.fuzz.origin[1] * 1e7),
            int(self.fuzz.origin[2] * 1e3),
        ]
        for i in (0, 1):
            self.send(i, mavlink.MAVLink_set_gps_global_origin_message(i + 1, *origin, 0), "vision")

    def send_batch(self, batch: list[tuple[str, bytes]]) -> None:
        """Step once, and send a batch of (name, frame) before and after the poses."""
        self.batch = batch
        self._send_part(len(batch) // 2)
        self._step()
        self._send_part(len(self.batch))

    def _see(self, p_n: Any, q_nb: Any) -> None:
        super()._see(p_n, q_nb)
        self._send_part(len(self.batch))

    def _send_part(self, count: int) -> None:
        said, self.batch = self.batch[:count], self.batch[count:]
        vehicle, interface, tally = self.pilots.vehicles[0], self.pilots.interfaces[0], self.tally
        for name, frame in said:
            link = interface.links[self.fuzz.rng.choice(("router", "router", "vision", "panic"))]
            answers, refusals = (
                len(link.queue),
                _refused(vehicle),
            )
            self.pilots.receive(0, link.name, frame)
            tally.sent[name] += 1
            tally.answered[name] += len(link.queue) > answers
            refused = _refused(vehicle) > refusals
            tally.refused[name] += refused or any(_refuses(data) for data in link.queue[answers:])

    def prepare(self, mode: str, height: float = 1.5) -> None:
        """Make both vehicles ready, and let them take off for the modes `hover` and `offboard`."""
        self.until(lambda f: all(v.ready_to_arm and v.home_n for v in f.pilots.vehicles), 20)
        if mode == "ground":
            return

        def stream(f: Flight) -> None:
            for i in (0, 1):
                f.setpoint(i, [0.0, 2.0 * i, -height])

        self.run(0.3, stream)
        assert [self.offboard(i) or self.arm(i) for i in (0, 1)] == [0, 0]
        self.until(lambda f: all(f.position(i)[2] < 0.2 - height for i in (0, 1)), 20, stream)
        self.run(2.0, stream)
        if mode == "hover":
            assert [self.command(i, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) for i in (0, 1)] == [0, 0]
            self.run(1.0)


# -- allowed effects of a message --------------------------------------------------------------------------------------


def named(m: Any, system: int = 1) -> bool:
    """Return whether a message is addressed to the vehicle and not sent by it."""
    component = getattr(m, "target_component", 0)
    own = m.get_srcSystem() == system and m.get_srcComponent() == 1
    return getattr(m, "target_system", None) == system and component in (0, 1) and not own


def arms(m: Any) -> bool:
    if not (m.get_type() in COMMANDS and named(m)):
        return False
    by_arming = m.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and m.param1 == 1.0
    return bool(by_arming or m.command == mavlink.MAV_CMD_MISSION_START)


STICKS = {"RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL"}


def moves(m: Any) -> bool:
    """Return whether a message may move a vehicle in HOLD."""
    name = m.get_type()
    if name in STICKS:  # their loss triggers a failsafe half a second later
        return True
    if not named(m):
        return False
    if name == "SET_MODE":
        return bool(m.base_mode & 1) and _other_mode(m.custom_mode >> 16 & 255, m.custom_mode >> 24 & 255)
    return _command_moves(m) if name in COMMANDS else name == "PARAM_SET" and _is_taken(m)


def _command_moves(m: Any) -> bool:
    p = (m.param1, m.param2, m.param3)
    sane = all(math.isfinite(x) for x in p)
    if m.command == mavlink.MAV_CMD_DO_SET_MODE:
        return sane and bool(int(p[0]) & 1) and _other_mode(int(p[1]), int(p[2]))
    if m.command == mavlink.MAV_CMD_DO_REPOSITION:
        return math.isfinite(p[1]) and int(p[1]) == 1
    return {
        mavlink.MAV_CMD_COMPONENT_ARM_DISARM: p[0] == 0.0 and p[1] == 21196.0,
        mavlink.MAV_CMD_NAV_LAND: True,
        mavlink.MAV_CMD_NAV_TAKEOFF: True,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: True,
        mavlink.MAV_CMD_MISSION_START: True,
        mavlink.MAV_CMD_DO_FLIGHTTERMINATION: math.isfinite(p[0]) and p[0] > 0.5,
        mavlink.MAV_CMD_INJECT_FAILURE: sane,
    }.get(m.command, False)


def _other_mode(main: int, sub: int) -> bool:
    return main == 6 or (main == 4 and sub in (2, 4, 5, 6))


def _is_taken(m: Any) -> bool:
    spec = SPECS.get(m.param_id)
    if spec is None or m.param_type != (6 if spec.type == "int32" else 9):
        return False
    value = (
        struct.unpack("<i", struct.pack("<f", m.param_value))[0] if spec.type == "int32" else m.param_value
    )
    return bool(math.isfinite(value) and spec.low <= value <= spec.high)


def _refuses(data: bytes) -> bool:
    m = read(data)
    return m is not None and m.get_type() in ANSWERS and getattr(m, ANSWERS[m.get_type()]) != 0


# -- conditions --------------------------------------------------------------------------------------------------------


def check(flight: Noisy) -> None:
    """Check that all state is finite and within its limits, and that all telemetry can be decoded."""
    pilots = flight.pilots
    est, cascade = pilots.est, pilots.cascade
    for name, array in (
        ("p_n", est.p_n),
        ("v_n", est.v_n),
        ("q_nb", est.q_nb),
        ("cov", est.cov),
        ("gyro_bias", est.gyro_bias),
        ("accel_bias", est.accel_bias),
        ("integral", cascade.position.integral),
        ("thrust", cascade.thrust),
        ("q_sp", cascade.q_sp),
        ("omega_sp", cascade.omega_sp),
        ("rate integral", cascade.rate.integral),
        ("motors", flight.motors),
        ("ring", est._ring_p),
    ):
        assert np.isfinite(array).all(), f"{name} is not finite: {array}"
    assert np.all((flight.motors >= 0.0) & (flight.motors <= 1.0))
    assert np.all(np.einsum("vii->vi", est.cov) >= 0.0), "a variance below zero"
    assert np.abs(cascade.position.integral).max() <= 20.0, "wound up"
    for name, spec in SPECS.items():
        assert np.all((pilots.params[name] >= spec.low) & (pilots.params[name] <= spec.high)), name
    for v in pilots.vehicles:
        assert all(math.isfinite(x) for x in (*(v.home_n or ()), *(v.origin or ()), v.offboard_setpoint_at))
    for messages in flight.received.values():
        for m in messages:
            _check_said(m)
        messages.clear()


def _refused(vehicle: Vehicle) -> int:
    counts = vehicle.received_counts()
    return counts["refused setpoint"] + counts["vision refused"]


def _check_said(m: Any) -> None:
    assert m.get_type() != "BAD_DATA"
    if m.get_type() in (
        "ATTITUDE",
        "ATTITUDE_QUATERNION",
        "LOCAL_POSITION_NED",
        "ATTITUDE_TARGET",
        "VFR_HUD",
    ):
        values = [x for name in m.get_fieldnames() for x in np.atleast_1d(getattr(m, name))]
        assert all(math.isfinite(x) for x in values), m


def weight(flight: Noisy) -> int:
    """Return the size [bytes] of the state that received messages can grow."""
    kept: list[Any] = []
    for v, x in zip(flight.pilots.vehicles, flight.pilots.interfaces, strict=True):
        kept += [v.missions, v.commander, v.counts]
        kept += [x.mission_protocol, x.param_server, x.counts]
        kept += [(link.queue, link.codec.counts) for link in x.links.values()]
    return len(pickle.dumps(kept))


# -- phases ------------------------------------------------------------------------------------------------------------


def powerless(messages: int, seed: int, *, per_step: int = 10) -> Tally:
    flight = Noisy(seed=seed, battery=0.0)
    flight.run(2.0)
    return _run(flight, messages, per_step, lambda m: True, lambda batch: _still(flight, (0, 1)))


def ground(messages: int, seed: int, *, per_step: int = 1, each: int = 5000) -> Tally:
    """Fly rounds of `each` messages, because a vehicle may crash by a valid command.

    A valid client sends commands too. In every other round no failure, parameter or termination is sent, so that it flies.
    """
    tally = Tally()
    for k in range(-(-messages // each)):
        flight = Noisy(seed=seed + k)
        flight.prepare("ground")
        disarmed = [SETTLED]  # steps since disarming

        def hold(batch: list[Any], flight: Noisy = flight, disarmed: list[int] = disarmed) -> None:
            now = flight.armed(0)
            assert disarmed[0] == 0 or not now or any(arms(m) for m in batch), "armed without a command"
            disarmed[0] = 0 if now else disarmed[0] + 1
            _still(flight, (0, 1) if disarmed[0] > SETTLED else (1,))

        def may(m: Any, kept: bool = bool(k % 2)) -> bool:
            return not (
                kept and moves(m) and (m.get_type() == "PARAM_SET" or getattr(m, "command", 0) in FATAL)
            )

        flight.client = CLIENT
        tally += _run(flight, min(each, messages - k * each), per_step, may, hold)
    return tally


def hover(messages: int, seed: int, *, per_step: int = 8) -> Tally:
    flight, quiet = Noisy(seed=seed), Noisy(seed=seed)
    for f in (flight, quiet):
        f.prepare("hover")
    place = flight.position(0).copy()

    def hold(batch: list[Any]) -> None:
        away = math.dist(flight.position(0), place)
        assert away < STAYS_WITHIN_M, f"moved by {away:.2f} m, {flight.mode(0)}"
        assert flight.mode(0) == "AUTO.LOITER" and flight.armed(0)
        while quiet.world.steps < flight.world.steps:
            quiet._step()
        quiet.received.forget(0)
        assert np.array_equal(flight.position(1), quiet.position(1)), "the neighbour moved"

    flight.fuzz.place = place.tolist()
    return _run(flight, messages, per_step, lambda m: not moves(m), hold)


def offboard(messages: int, seed: int, *, each: int = 3000) -> Tally:
    """Send position setpoints, one in three a valid one. Accelerations, which have no speed limit, are left out."""
    tally = Tally()
    for k in range(-(-messages // each)):
        flight = Noisy(seed=seed + k, params=LIMITS)
        flight.prepare("offboard", height=8.0)
        tally += _setpoints(
            flight, min(each, messages - k * each), SETPOINTS, _within_limits, ignored=NO_ACCELERATION
        )
        for _ in range(50):
            flight.setpoint(0, [0.0, 0.0, -8.0])
            flight.run(0.02)
        assert flight.command(0, mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 3) == 0
        flight.run(6.0)
        assert np.linalg.norm(flight.pilots.est.v_n[0]) < 0.3, "does not hold again"
    return tally


def wild(messages: int, seed: int, *, each: int = 3000) -> Tally:
    tally = Tally()
    for k in range(-(-messages // each)):
        flight = Noisy(seed=seed + k, params={"COM_DISARM_LAND": -1.0, "COM_DISARM_PRFLT": -1.0})
        flight.prepare("offboard", height=8.0)
        tally += _setpoints(
            flight, min(each, messages - k * each), ("SET_ATTITUDE_TARGET", *SETPOINTS), lambda f: None
        )
    return tally


def _setpoints(flight: Noisy, messages: int, names: tuple[str, ...], hold: Any, *, ignored: int = 0) -> Tally:
    rng, sent = flight.fuzz.rng, 0
    while sent < messages:
        flight.fuzz.place = flight.position(0).tolist()
        if rng.random() < 0.33:
            flight.setpoint(0, [rng.uniform(-5, 5), rng.uniform(-5, 5), -rng.uniform(6, 12)])
        batch = [_setpoint(flight, name, ignored) for name in rng.choices(names, k=rng.choice((3, 20, 60)))]
        sent += len(batch)
        flight.send_batch(batch)
        for _ in range(rng.choice((1, 5, 25, 150))):
            flight._step()
            hold(flight)
        # Refused setpoints do not keep OFFBOARD; that is tested elsewhere.
        flight.pilots.vehicles[0].offboard.received_at[0] = flight.now
        check(flight)
    return flight.tally


def _setpoint(flight: Noisy, name: str, ignored: int) -> tuple[str, bytes]:
    if not ignored:
        return name, flight.fuzz.frame(name)
    kind = KINDS[name]
    values = flight.fuzz.values(kind)
    values["type_mask"] |= ignored
    return name, v2(kind, flight.fuzz.payload(kind, values), (255, 190))


def _within_limits(flight: Noisy) -> None:
    truth = flight.world.truth()
    if truth.p_n[0, 2] > -1.0:
        return  # near the floor
    tilt, asked = (
        math.degrees(math.acos(min(1.0, 1.0 - 2.0 * (q[1] ** 2 + q[2] ** 2))))
        for q in (truth.q_nb[0], flight.pilots.cascade.q_sp[0])
    )
    assert asked < LIMITS["MPC_TILTMAX_AIR"] + 0.1, f"asks for a tilt of {asked:.0f} degrees"
    v = truth.v_n[0]
    assert tilt < TILT_DEG, f"tilted by {tilt:.0f} degrees"
    assert math.hypot(v[0], v[1]) < SPEED and abs(v[2]) < SPEED_D, f"flies at {v}"


def _run(flight: Noisy, messages: int, per_step: int, may: Any, hold: Any) -> Tally:
    """Send messages that `may` allows; call `hold` with them after each step."""
    middle = 0
    while (sent := flight.tally.sent.total()) < messages:
        if not middle and sent >= messages // 2:
            middle = weight(flight)
        batch: list[tuple[str, bytes]] = []
        if flight.client and flight.fuzz.rng.random() < 0.004:
            batch += [
                ("COMMAND_LONG", flight.fuzz.command(*said)) for said in flight.fuzz.rng.choice(flight.client)
            ]
        while len(batch) < per_step:
            batch += flight.fuzz.some()
        meant = [(x, m) for x, m in ((x, read(x[1])) for x in batch) if m is not None and may(m)]
        flight.send_batch([x for x, _ in meant])
        hold([m for _, m in meant])
        if flight.world.steps % 10 == 0:
            check(flight)
    check(flight)
    assert weight(flight) < 1.5 * middle + 100_000, "the state grows with the messages"
    return flight.tally


def _still(flight: Noisy, which: tuple[int, ...]) -> None:
    for i in which:
        assert not flight.armed(i) and not flight.motors[i].any(), f"vehicle {i + 1} is not at rest"


PHASES = {"powerless": powerless, "ground": ground, "hover": hover, "offboard": offboard, "wild": wild}
SHARES = {"powerless": 0.3, "ground": 0.2, "hover": 0.36, "offboard": 0.07, "wild": 0.07}
