"""Cases of OFFBOARD: rules for entering it, and the effect of each setpoint's mask and frame in the air."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from arena.geometry import quat_from_euler
from px4_contract.flying import come_down, hover, state
from px4_contract.registry import case
from px4_contract.rig import Each, Rig, Setup
from px4_contract.transcript import Transcript

NAN, INF = math.nan, math.inf
POSITION, VELOCITY, ACCELERATION = 0b110111111000, 0b110111000111, 0b110000111111
YAW, YAW_RATE, FORCE = 0x400, 0x800, 0x200


def every(hz: float, say: Each) -> Each:
    """Return a function for `Rig.each` that calls `say` at a rate of `hz`."""
    last = [-1e9]

    def each(r: Rig) -> None:
        if r.now - last[0] >= 1.0 / hz - 1e-6:
            last[0] = r.now
            say(r)

    return each


def attitude(
    mask: int, q: Any = (1, 0, 0, 0), rates: tuple[float, float, float] = (0, 0, 0), thrust: float = 0.5
) -> Each:
    return lambda r: r.send(
        mavlink.MAVLink_set_attitude_target_message(0, r.id, 1, mask, list(q), *rates, thrust)
    )


def global_int(mask: int, frame: int, p: Any = (0, 0, 0), v: Any = (0, 0, 0)) -> Each:
    """Return a function that sends a global setpoint.

    p: latitude, longitude [1e-7 deg], height above the home position [m]. v: velocity [m/s] [NED]
    """

    def send(r: Rig) -> None:
        m = r.state.get("GLOBAL_POSITION_INT")
        above_sea = frame == mavlink.MAV_FRAME_GLOBAL_INT and m is not None
        height = p[2] + ((m.alt - m.relative_alt) * 1e-3 if above_sea else 0.0)
        r.send(
            mavlink.MAVLink_set_position_target_global_int_message(
                0, r.id, 1, frame, mask, int(p[0]), int(p[1]), height, *v, 0, 0, 0, 0, 0
            )
        )

    return send


def local(mask: int, **values: Any) -> Each:
    return lambda r: r.local(mask, **values)


@case(
    "offboard entered",
    "requested while in HOLD: without setpoints, after one, at each rate, with setpoints of each kind",
    ground=False,
)
def entered(r: Rig, t: Transcript) -> None:
    def asks(key: str) -> None:
        """Request OFFBOARD in the air, from HOLD, and record the result.

        On the ground PX4 always accepts OFFBOARD and then waits for setpoints.
        """
        r.clear()
        r.run(0.4)
        t.words(f"{key}: texts before", "; ".join(dict.fromkeys(f"{s} {x}" for s, x in r.texts())))
        t.note(f"{key}: ack", r.set_mode(6))
        r.run(0.1)
        t.note(f"{key}: mode", r.mode)
        r.each.clear()
        r.set_mode(4, 3)
        r.until(lambda r: r.mode == "AUTO.LOITER" and abs(r.p_n[2] + 2.0) < 0.7, 8.0)
        r.run(1.3)

    hover(r, 2.0, stream=False)
    r.set_mode(4, 3)
    r.command(511, 436, 50_000)
    r.run(2.0)
    asks("no setpoints")
    r.local(POSITION, (0, 0, -2))
    r.run(0.2)
    asks("one setpoint")
    for hz in (0.5, 1.0, 1.5, 2.0, 3.0, 10.0):
        r.each.append(every(hz, local(POSITION, p=(0, 0, -2))))
        r.run(4.0)
        asks(f"at {hz:g} Hz")
    for key, say in (
        ("nothing given", local(0b110111111111, p=(0, 0, -2))),
        ("all nan", local(POSITION, p=(NAN, NAN, NAN))),
        ("one nan", local(POSITION, p=(NAN, 0, -2))),
        ("infinite", local(POSITION, p=(INF, 0, -2))),
        ("velocity nan", local(VELOCITY, v=(NAN, NAN, NAN))),
        ("force", local(POSITION | FORCE, p=(0, 0, -2))),
        ("only yaw", local(0b110111111111 & ~YAW, yaw=0.5)),
        ("only yaw rate", local(0b110111111111 & ~YAW_RATE, rate=0.5)),
        ("acceleration", local(ACCELERATION, a=(0, 0, 0))),
        ("force bit, acceleration", local(ACCELERATION | FORCE, a=(0, 0, 0))),
        ("frame 99", local(POSITION, p=(0, 0, -2), frame=99)),
        ("frame 0", local(POSITION, p=(0, 0, -2), frame=0)),
        ("BODY_NED position", local(POSITION, p=(0, 0, -2), frame=8)),
        ("OFFSET_NED", local(POSITION, p=(0, 0, -2), frame=7)),
        ("BODY_OFFSET_NED velocity", local(VELOCITY, v=(0, 0, 0), frame=9)),
        ("BODY_FRD velocity", local(VELOCITY, v=(0, 0, 0), frame=12)),
        ("x alone", local(0b110111111110, p=(0, 0, -2))),
        ("z alone", local(0b110111111011, p=(0, 0, -2))),
        ("attitude", attitude(0b111)),
        ("attitude, thrust ignored", attitude(0b1000111)),
        ("attitude, thrust nan", attitude(0b111, thrust=NAN)),
        ("attitude nan", attitude(0b111, q=(NAN,) * 4)),
        ("attitude of zero length", attitude(0b111, q=(0, 0, 0, 0))),
        ("attitude of length 3", attitude(0b111, q=(3, 0, 0, 0))),
        ("rates", attitude(0b10000000)),
        ("rates, one ignored", attitude(0b10000001)),
        ("rates nan", attitude(0b10000000, rates=(NAN, 0, 0))),
        ("everything ignored", attitude(0b11000111)),
        ("thrust beyond 1", attitude(0b111, thrust=7.0)),
        ("global relative", global_int(POSITION, 6, (473977420, 85455940, 2.0))),
        ("global amsl", global_int(POSITION, 5, (473977420, 85455940, 2.0))),
    ):
        r.each.append(say)
        r.run(1.5)
        asks(key)
    r.each.append(
        lambda r: r.send(
            mavlink.MAVLink_set_position_target_local_ned_message(0, 7, 1, 1, POSITION, 0, 0, -2, *[0] * 8)
        )
    )
    r.run(1.5)
    asks("setpoints for another system")
    r.each.append(
        lambda r: r.send(
            mavlink.MAVLink_set_position_target_local_ned_message(0, 0, 0, 1, POSITION, 0, 0, -2, *[0] * 8)
        )
    )
    r.run(1.5)
    asks("setpoints for everybody")
    come_down(r)


# name, what to say, for how long [s]. Each begins hovering at (0, 0, -1.5), nose 0.6 rad east of north.
NOSE = 0.6
_Q_PITCH = tuple(quat_from_euler((0.0, -0.1, NOSE)).tolist())
_Q_LEVEL = tuple(quat_from_euler((0.0, 0.0, NOSE)).tolist())
HOVER_THRUST = 0.5652
SETPOINTS: tuple[tuple[str, Each, float], ...] = (
    ("position", local(POSITION & ~YAW, p=(1, 0.5, -1.8), yaw=NOSE), 4.0),
    ("position without yaw", local(POSITION, p=(1, 0.5, -1.8)), 4.0),
    ("position with yaw rate", local(POSITION & ~YAW_RATE, p=(1, 0.5, -1.8), rate=0.5), 4.0),
    ("yaw and yaw rate", local(POSITION & ~YAW & ~YAW_RATE, p=(0, 0, -1.5), yaw=NOSE + 1.0, rate=0.2), 4.0),
    (
        "position and velocity",
        local(POSITION & VELOCITY & ~YAW, p=(0, 0, -1.5), v=(0.5, 0, 0), yaw=NOSE),
        4.0,
    ),
    (
        "position, velocity, acceleration",
        local(0, p=(0, 0, -1.5), v=(0.3, 0, 0), a=(0.3, 0, 0), yaw=NOSE, rate=0.0),
        4.0,
    ),
    ("x, y position and z velocity", local(0b100111011100, p=(1, 0, 0), v=(0, 0, -0.3), yaw=NOSE), 3.0),
    ("z position and x, y velocity", local(0b100111100011, p=(0, 0, -1.5), v=(0.5, -0.3, 0), yaw=NOSE), 3.0),
    ("x position alone", local(0b100111111110, p=(1, 0, 0), yaw=NOSE), 3.0),
    ("z position alone", local(0b100111111011, p=(0, 0, -2.0), yaw=NOSE), 3.0),
    ("velocity", local(VELOCITY & ~YAW, v=(0.6, -0.4, -0.2), yaw=NOSE), 3.0),
    ("velocity without yaw", local(VELOCITY, v=(0.6, -0.4, -0.2)), 3.0),
    ("velocity with yaw rate", local(VELOCITY & ~YAW_RATE, v=(0.5, 0, 0), rate=0.5), 3.0),
    ("velocity, x ignored", local((VELOCITY | 0b1000) & ~YAW, v=(0.6, -0.4, 0), yaw=NOSE), 3.0),
    ("velocity nan in x", local(VELOCITY & ~YAW, v=(NAN, 0.5, 0), yaw=NOSE), 3.0),
    (
        "velocity and acceleration",
        local(VELOCITY & ACCELERATION & ~YAW, v=(0.5, 0, 0), a=(0.2, 0, 0), yaw=NOSE),
        3.0,
    ),
    ("acceleration", local(ACCELERATION & ~YAW, a=(0.4, 0, 0), yaw=NOSE), 2.0),
    ("acceleration up", local(ACCELERATION & ~YAW, a=(0.0, 0, -0.4), yaw=NOSE), 2.0),
    ("BODY_NED velocity", local(VELOCITY & ~YAW, v=(0.6, 0, 0), yaw=NOSE, frame=8), 3.0),
    ("BODY_NED velocity, yaw rate", local(VELOCITY & ~YAW_RATE, v=(0.6, 0, 0), rate=0.3, frame=8), 3.0),
    (
        "BODY_NED velocity, x ignored",
        local((VELOCITY | 0b1000) & ~YAW, v=(0.6, 0.4, 0), yaw=NOSE, frame=8),
        3.0,
    ),
    ("BODY_NED position", local(POSITION & ~YAW, p=(1, 0, 0), yaw=NOSE, frame=8), 3.0),
    (
        "BODY_NED position and velocity",
        local(POSITION & VELOCITY & ~YAW, p=(1, 0, 0), v=(0.5, 0, 0), yaw=NOSE, frame=8),
        3.0,
    ),
    ("BODY_NED acceleration", local(ACCELERATION & ~YAW, a=(0.4, 0, 0), yaw=NOSE, frame=8), 2.0),
    ("LOCAL_OFFSET_NED position", local(POSITION & ~YAW, p=(1, 0, 0), yaw=NOSE, frame=7), 3.0),
    ("BODY_OFFSET_NED position", local(POSITION & ~YAW, p=(1, 0, 0), yaw=NOSE, frame=9), 3.0),
    ("BODY_OFFSET_NED velocity", local(VELOCITY & ~YAW, v=(0.6, 0, 0), yaw=NOSE, frame=9), 3.0),
    ("BODY_FRD velocity", local(VELOCITY & ~YAW, v=(0.6, 0, 0), yaw=NOSE, frame=12), 3.0),
    ("LOCAL_FRD velocity", local(VELOCITY & ~YAW, v=(0.6, 0, 0), yaw=NOSE, frame=20), 3.0),
    ("nothing given", local(0b110111111111), 3.0),
    ("yaw alone", local(0b110111111111 & ~YAW, yaw=NOSE + 1), 3.0),
    ("takeoff bit", local(POSITION & ~YAW | 0x1000, p=(1, 0, -1.5), yaw=NOSE), 3.0),
    ("land bit", local(POSITION & ~YAW | 0x2000, p=(1, 0, -1.5), yaw=NOSE), 3.0),
    ("loiter bit", local(POSITION & ~YAW | 0x3000, p=(1, 0, -1.5), yaw=NOSE), 3.0),
    ("idle bit", local(POSITION & ~YAW | 0x4000, p=(1, 0, -1.5), yaw=NOSE), 3.0),
    ("far away", local(POSITION & ~YAW, p=(30, 0, -1.5), yaw=NOSE), 2.0),
    ("attitude", attitude(0b111, _Q_PITCH, thrust=HOVER_THRUST), 1.5),
    ("attitude of length 3", attitude(0b111, [3 * x for x in _Q_PITCH], thrust=HOVER_THRUST), 1.5),
    ("attitude with yaw rate", attitude(0b011, _Q_LEVEL, rates=(0, 0, 0.5), thrust=HOVER_THRUST), 1.5),
    ("attitude with all rates", attitude(0, _Q_PITCH, rates=(0, 0, 0), thrust=HOVER_THRUST), 1.5),
    ("attitude, thrust ignored", attitude(0b1000111, _Q_LEVEL, thrust=HOVER_THRUST), 1.0),
    ("attitude nan", attitude(0b111, (NAN,) * 4, thrust=HOVER_THRUST), 1.0),
    ("attitude of zero length", attitude(0b111, (0, 0, 0, 0), thrust=HOVER_THRUST), 1.0),
    ("rates", attitude(0b10000000, rates=(0, -0.3, 0), thrust=HOVER_THRUST), 0.6),
    ("rates, yaw", attitude(0b10000000, rates=(0, 0, 0.8), thrust=HOVER_THRUST), 1.0),
    ("rates, one ignored", attitude(0b10000010, rates=(0, -0.3, 0.8), thrust=HOVER_THRUST), 0.6),
    ("rates nan", attitude(0b10000000, rates=(NAN, 0, 0), thrust=HOVER_THRUST), 0.6),
    ("thrust nan", attitude(0b111, _Q_LEVEL, thrust=NAN), 0.6),
    ("thrust negative", attitude(0b111, _Q_LEVEL, thrust=-0.5), 0.3),
    ("thrust more", attitude(0b111, _Q_LEVEL, thrust=HOVER_THRUST + 0.05), 1.0),
    ("thrust body", attitude(0b111, _Q_LEVEL, thrust=HOVER_THRUST - 0.03), 1.0),
    ("global relative height", global_int(POSITION & ~YAW, 6, (473977510, 85455940, 2.0)), 4.0),
    ("global amsl", global_int(POSITION & ~YAW, 5, (473977510, 85455940, 2.0)), 4.0),
    ("global velocity", global_int(VELOCITY & ~YAW, 6, v=(0.6, 0, 0)), 3.0),
    ("global, frame of the floor", global_int(POSITION & ~YAW, 11, (473977510, 85455940, 2.0)), 4.0),
)


def _yaw(r: Rig) -> float:
    w, x, y, z = r.truth().q_nb[0]
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def _settle(r: Rig) -> bool:
    """Return the vehicle to the start state of each observation; return False if this fails."""
    r.each[:] = [r.position(0.0, 0.0, -1.5, NOSE)]
    r.run(0.3)
    r.set_mode(6)  # whatever the last heartbeat, a second old, said
    done = r.until(
        lambda r: (
            np.linalg.norm(r.p_n - (0, 0, -1.5)) < 0.15
            and np.linalg.norm(r.truth().v_n[0]) < 0.08
            and abs(_yaw(r) - NOSE) < 0.08
        ),
        15.0,
    )
    r.run(0.5)
    return done is not None and r.armed


def one_setpoint(r: Rig, t: Transcript, name: str, say: Each, seconds: float) -> None:
    begin, yaw = r.p_n.copy(), _yaw(r)
    r.each[:] = [say]
    r.clear()
    r.run(seconds)
    moved, turned = r.p_n - begin, math.remainder(_yaw(r) - yaw, 2 * math.pi)
    t.note(f"{name}: state", state(r))
    # Where it has ended may differ by a third: the cascades are alike, not the same.
    for axis, value in zip(("north", "east", "down"), moved, strict=True):
        t.number(f"{name}: {axis}", float(value), near=0.25, part=0.3, unit="m")
    t.number(f"{name}: turned", turned, near=0.15, part=0.25, unit="rad")
    m = r.state.get("POSITION_TARGET_LOCAL_NED")
    if m is not None and r.received and any(h.name == "POSITION_TARGET_LOCAL_NED" for h in r.received):
        given = " ".join(
            k
            for k, v in zip(
                ["x", "y", "z", "vx", "vy", "vz", "yaw"],
                (m.x, m.y, m.z, m.vx, m.vy, m.vz, m.yaw),
                strict=True,
            )
            if math.isfinite(v)
        )
        t.note(f"{name}: target sent", given)
    t.note(f"{name}: complains", any(s <= 4 for s, _ in r.texts()))
    t.words(f"{name}: texts", "; ".join(dict.fromkeys(f"{s} {x}" for s, x in r.texts())))


def _register(part: str, which: slice) -> None:
    @case(
        f"setpoints in the air, {part}",
        "each mask and frame, hovering: position after some seconds",
        ground=False,
        setup=Setup(),
    )
    def run(r: Rig, t: Transcript) -> None:
        hover(r)
        for name, say, seconds in SETPOINTS[which]:
            if not _settle(r):
                t.note(f"{name}: it had been lost before", True)
                r.each.clear()
                return
            one_setpoint(r, t, name, say, seconds)
        _settle(r)
        come_down(r)


_register("position", slice(0, 10))
_register("velocity", slice(10, 18))
_register("frames", slice(18, 36))
_register("attitude", slice(36, 51))
_register("global", slice(51, None))
