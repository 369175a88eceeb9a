"""Cases of arming: every refusal that can be provoked, acceptance, and automatic disarming."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common as mavlink

from px4_contract.flying import complaint, state
from px4_contract.registry import case
from px4_contract.rig import Rig, Setup
from px4_contract.transcript import Transcript


def tries(r: Rig, t: Transcript, key: str, *, force: bool = False) -> None:
    r.clear()
    t.note(f"{key}: ready to arm, reported", r.may_arm)
    t.note(f"{key}: ack", r.arm(force=force))
    r.run(0.5)
    complaint(r, t, key)
    t.note(f"{key}: state", state(r))
    if r.armed:
        r.disarm(force=True)
        r.run(0.5)


@case("arm and disarm", "twice in HOLD on the ground; then the time until it disarms by itself", ground=False)
def arm_and_disarm(r: Rig, t: Transcript) -> None:
    for key, do in (
        ("arm", r.arm),
        ("arm again", r.arm),
        ("disarm", r.disarm),
        ("disarm again", r.disarm),
        ("arm", r.arm),
    ):
        r.clear()
        t.note(f"{key}: ack", do())
        # PX4's logger names its file at once or later.
        t.note(f"{key}: severities", " ".join(str(s) for s, x in r.texts() if "[logger]" not in x) or "none")
        t.words(f"{key}: texts", "; ".join(x for _, x in r.texts()))
        t.note(f"{key}: state", state(r))
    r.clear()
    t.number("disarms by itself after", r.until(lambda r: not r.armed, 30.0), near=1.5, unit="s")
    t.note("severities", " ".join(str(s) for s, _ in r.texts()) or "none")
    t.words("texts", "; ".join(x for _, x in r.texts()))


@case(
    "arm without poses",
    "without any pose: in HOLD, by force, in every available mode",
    setup=Setup(poses=False),
    ground=False,
)
def without_poses(r: Rig, t: Transcript) -> None:
    r.run(5.0)
    r.command(511, 436, 50_000)
    t.note("mode", r.mode)
    tries(r, t, "in HOLD")
    for main, sub in ((4, 3), (4, 2), (4, 6), (3, 0), (2, 0), (7, 0), (1, 0), (5, 0)):
        r.clear()
        t.note(f"mode {main}.{sub}: ack", r.set_mode(main, sub))
        r.run(0.2)
        t.note(f"mode {main}.{sub}: after", r.mode)
    for key, mask, message in (
        ("position", 0b100111111000, "local"),
        ("attitude", 0, "attitude"),
        ("rates", 0b10000000, "attitude"),
    ):

        def speak(r: Rig, mask: int = mask, message: str = message) -> None:
            if message == "local":
                r.local(mask, (0, 0, 0))
            else:
                r.send(
                    mavlink.MAVLink_set_attitude_target_message(0, r.id, 1, mask, [1, 0, 0, 0], 0, 0, 0, 0.0)
                )

        r.each.append(speak)
        r.run(1.0).clear()
        t.note(f"OFFBOARD by {key}: ack", r.set_mode(6))
        r.run(0.2)
        t.note(f"OFFBOARD by {key}: mode", r.mode)
        tries(r, t, f"OFFBOARD by {key}")
        r.set_mode(4, 3)
        r.each.clear()
    tries(r, t, "by force", force=True)


@case(
    "arm after poses were lost",
    "poses stop on the ground: time until not ready, result of arming; then poses return",
    ground=False,
)
def poses_lost(r: Rig, t: Transcript) -> None:
    r.poses = False
    t.number("not ready after", r.until(lambda r: not r.may_arm, 20.0), near=1.5, part=0.4, unit="s")
    r.run(6.0)
    tries(r, t, "lost")
    r.poses = True
    t.number("ready again after", r.until(lambda r: r.may_arm, 20.0), near=2.5, part=0.5, unit="s")
    tries(r, t, "back")


@case("arm in each mode", "armed in every mode that a disarmed vehicle accepts", ground=False)
def each_mode(r: Rig, t: Transcript) -> None:
    r.each.append(r.position(0.0, 0.0, -0.5))
    for main, sub in ((4, 3), (4, 4), (4, 5), (4, 6), (6, 0), (4, 2), (3, 0), (2, 0), (7, 0)):
        r.set_mode(4, 3)
        t.note(f"{main}.{sub}: mode ack", r.set_mode(main, sub))
        r.settle()
        t.note(f"{main}.{sub}: mode", r.mode)
        tries(r, t, f"{main}.{sub}")


@case("arm with a low battery", "arming with the battery below each threshold", ground=False)
def low_battery(r: Rig, t: Transcript) -> None:
    from px4_contract.params import FLOAT, write

    t.note("COM_ARM_BAT_MIN 0.99 answer", write(r, "COM_ARM_BAT_MIN", 0.995, FLOAT))
    r.run(2.0)
    tries(r, t, "below COM_ARM_BAT_MIN")


@case(
    "arm tilted",
    "poses of a tilted vehicle are ignored; a tilted vehicle is refused",
    ground=False,
    setup=Setup(),
)
def wrong_yaw(r: Rig, t: Transcript) -> None:
    r.shift[:] = (math.pi, 0.0, 0.0)
    r.run(1.0)
    tries(r, t, "poses jump 3 m")
    r.run(8.0)
    tries(r, t, "8 s after the jump")
