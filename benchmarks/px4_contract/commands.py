"""Cases of commands on the ground.

Each command is sent with valid and invalid arguments, as COMMAND_LONG and COMMAND_INT, and to other ids.
Every flight mode is requested.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import common as mavlink

from px4_contract.flying import hover, state
from px4_contract.registry import case
from px4_contract.rig import Rig
from px4_contract.transcript import Transcript

NAN = math.nan
# name, command, parameters: on the ground, disarmed. None of them may move anything.
ON_THE_GROUND: tuple[tuple[str, int, tuple[float, ...]], ...] = (
    ("arm 2", 400, (2,)),
    ("arm nan", 400, (NAN,)),
    ("arm 0.5", 400, (0.5,)),
    ("disarm, disarmed", 400, (0,)),
    ("disarm by force, disarmed", 400, (0, 21196)),
    ("run prearm checks", 401, ()),
    ("set mode without the custom flag", 176, (0, 4, 3)),
    ("set mode, sub mode of no mode", 176, (1, 4, 99)),
    ("set mode nan", 176, (1, NAN, NAN)),
    ("set mode, no main mode", 176, (1, 0, 0)),
    ("set mode 255", 176, (1, 255, 255)),
    ("set mode HOLD", 176, (1, 4, 3)),
    ("loiter unlimited", 17, ()),
    ("loiter time", 19, (5,)),
    ("pause", 193, (0,)),
    ("continue", 193, (1,)),
    ("pause nan", 193, (NAN,)),
    ("reposition, no change of mode", 192, (-1, 0, 0, NAN, NAN, NAN, NAN)),
    ("change speed", 178, (1, 3, -1)),
    ("change speed nan", 178, (1, NAN, -1)),
    ("change speed, default", 178, (1, -2, -1)),
    ("set home here", 179, (1,)),
    ("set home there", 179, (0, 0, 0, NAN, 47.3978, 8.5456, 488)),
    ("set home at no place", 179, (0, 0, 0, NAN, 200, 500, 0)),
    ("set home nan", 179, (0, 0, 0, NAN, NAN, NAN, NAN)),
    ("get home position", 410, ()),
    ("region of interest", 195, (0, 0, 0, 0, 47.3978, 8.5456, 488)),
    ("no region of interest", 197, ()),
    ("mission start", 300, (0, 0)),
    ("mission start, nothing to fly", 300, (5, 9)),
    ("set mission current", 224, (0,)),
    ("fence enable", 207, (1,)),
    ("parachute", 208, (0,)),
    ("motor test", 209, (1, 0, 0, 0)),
    ("actuator test", 310, (NAN, 1, 0, 0, 1)),
    ("configure actuator", 311, (1,)),
    ("calibrate nothing", 241, ()),
    ("calibrate gyro", 241, (1,)),
    ("calibrate level", 241, (0, 0, 0, 0, 2)),
    ("sensor offsets", 242, ()),
    ("store parameters", 245, (1,)),
    ("read parameters", 245, (0,)),
    ("storage nan", 245, (NAN,)),
    ("reboot -1", 246, (-1, -1, -1, -1)),
    ("reboot nothing", 246, (0,)),
    ("reboot 7", 246, (7,)),
    ("reboot nan", 246, (NAN,)),
    ("do flight termination 0", 185, (0,)),
    ("control gimbal", 205, (0, 0, 0)),
    ("gimbal manager pitch yaw", 1000, (0, 0, NAN, NAN)),
    ("gimbal manager configure", 1001, ()),
    ("set servo", 183, (1, 1500)),
    ("set actuator", 187, (0, 0, 0, 0, 0, 0, 0)),
    ("set relay", 181, (0, 1)),
    ("take a picture", 2000, (0, 0, 1)),
    ("start video", 2500, ()),
    ("camera trigger", 203, (0, 0, 0, 0, 1)),
    ("storage format", 526, (1, 1)),
    ("request camera information", 521, (1,)),
    ("request storage information", 525, (0, 1)),
    ("request flight information", 528, (1,)),
    ("logging start", 2510, (0,)),
    ("logging stop", 2511, ()),
    ("control high latency", 2600, (0,)),
    ("orbit", 34, (5, 1, 0, NAN, NAN, NAN, NAN)),
    ("follow", 32, ()),
    ("guided enable", 92, (1,)),
    ("set standard mode", 262, (0,)),
    ("inject failure", 420, (0, 0, 0)),
    ("takeoff local", 24, (0, 0, 1, 0, 0, 0, -2)),
    ("land local", 23, ()),
    ("vtol transition", 3000, (3,)),
    ("external position estimate", 43003, (0, 0, 0.1, NAN, 47.397742, 8.545594, NAN)),
    ("payload deploy", 30001, ()),
    ("autotune", 212, (0,)),
    ("preflight uavcan", 243, (0,)),
    ("set camera mode", 530, (0, 0)),
    ("request events", 12901, ()),
    ("set sys status", 521, ()),
    ("user command", 31010, ()),
    ("no such command", 60123, ()),
    ("command 0", 0, ()),
    ("do jump", 177, (1, 1)),
    ("delay", 112, (1,)),
    ("waypoint", 16, (0, 0, 0, NAN, 47.3978, 8.5456, 10)),
    ("spline waypoint", 82, ()),
    ("precision loiter", 31, ()),
    ("figure eight", 35, ()),
    ("override goto", 252, (0,)),
)


@case(
    "commands on the ground",
    "commands with good and bad arguments to a disarmed vehicle: every acknowledgement in order",
    ground=False,
)
def on_the_ground(r: Rig, t: Transcript) -> None:
    for name, number, p in ON_THE_GROUND:
        r.clear()
        t.note(f"{name}: ack", r.command(number, *p))
        texts = r.texts()
        t.note(f"{name}: complains", any(s <= 4 for s, _ in texts))
        t.words(f"{name}: texts", "; ".join(f"{s} {x}" for s, x in texts))
        t.note(f"{name}: state after", state(r))
        if r.armed:
            r.disarm(force=True)
        if r.mode != "AUTO.LOITER":
            r.set_mode(4, 3)


@case("commands as COMMAND_INT", "the commands of COMMAND_LONG, sent as COMMAND_INT")
def as_int(r: Rig, t: Transcript) -> None:
    for name, number, p in (
        ("arm", 400, (1,)),
        ("disarm", 400, (0,)),
        ("arm 2", 400, (2,)),
        ("set mode LAND", 176, (1, 4, 6)),
        ("set mode HOLD", 176, (1, 4, 3)),
        ("request message", 512, (148,)),
        ("set interval", 511, (30, 0)),
        ("get interval", 510, (30,)),
        ("set home there", 179, (0, 0, 0, 0, 473978000, 85456000, 488)),
        ("set home, no place", 179, (0, 0, 0, 0, 2147483647, 2147483647, 488)),
        ("reposition, no place", 192, (-1, 0, 0, NAN, NAN, NAN, NAN)),
        ("loiter", 17, ()),
        ("no such command", 60123, ()),
        ("change speed", 178, (1, 3, -1)),
    ):
        t.note(f"{name}: ack", r.command(number, *p, way="int"))
        t.note(f"{name}: state after", state(r))
    r.disarm(force=True)
    for frame in (0, 1, 3, 5, 6, 12, 99):
        t.note(
            f"set home in frame {frame}: ack",
            r.command(179, 0, 0, 0, 0, 473978000, 85456000, 488, way="int", frame=frame),
        )


@case("targets", "the same command to the vehicle, to other vehicles, as a broadcast; from unknown senders")
def targets(r: Rig, t: Transcript) -> None:
    for key, to in (
        ("it", (r.id, 1)),
        ("its any component", (r.id, 0)),
        ("its camera", (r.id, 100)),
        ("its MAV_COMP_ID_ALL but another system", (7, 0)),
        ("another system", (7, 1)),
        ("everybody", (0, 0)),
        ("component 1 of any system", (0, 1)),
    ):
        for number, p in ((512, (148,)), (400, (0,)), (176, (1, 4, 3)), (60123, ())):
            r.clear()
            t.note(f"{number} to {key}", r.command(number, *p, to=to))
    r.clear()
    t.note("arm to everybody", r.command(400, 1, to=(0, 0)))
    t.note("armed by a broadcast", r.settle().armed)
    r.disarm(force=True)


@case(
    "modes on the ground",
    "every main and sub mode, requested by MAV_CMD_DO_SET_MODE, disarmed: ack, mode afterwards, text or none",
)
def modes(r: Rig, t: Transcript) -> None:
    # Disarmed in OFFBOARD without setpoints PX4 computes no motors, and its simulator waits for them for ever.
    r.each.append(r.position(0.0, 0.0, -1.0))
    r.command(511, 436, 50_000)
    asked = (
        [(m, 0) for m in (1, 2, 3, 5, 6, 7, 8, 9, 10, 11)]
        + [(3, s) for s in (1, 2)]
        + [(4, s) for s in range(20)]
    )
    for main, sub in asked:
        r.set_mode(4, 3)
        r.clear()
        t.note(f"{main}.{sub}: ack", r.set_mode(main, sub))
        r.run(0.2)
        t.note(f"{main}.{sub}: mode after", r.mode)
        t.note(f"{main}.{sub}: complains", any(s <= 4 for s, _ in r.texts()))
        t.words(f"{main}.{sub}: texts", "; ".join(f"{s} {x}" for s, x in r.texts()))
    r.set_mode(4, 3)
    for main, sub in ((4, 6), (4, 4), (6, 0), (3, 0), (4, 3)):
        r.clear()
        r.send(mavlink.MAVLink_set_mode_message(r.id, 1, main << 16 | sub << 24))
        r.run(0.5)
        t.note(f"SET_MODE {main}.{sub}: mode after", r.mode)
        acks = [h.m.result for h in r.received if h.name == "COMMAND_ACK"]
        t.note(f"SET_MODE {main}.{sub}: acks", str(acks))
    r.set_mode(4, 3)
    r.command(511, 436, 0)
    r.each.clear()


@case("reboot", "MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN with 1, disarmed", ground=False)
def reboot(r: Rig, t: Transcript) -> None:
    t.note("armed: arm ack", r.arm())
    r.clear()
    t.note("armed: ack", r.command(246, 1))
    t.note("armed: still armed", r.settle().armed)
    r.disarm()
    r.clear()
    t.note("ack", r.command(246, 1))


@case(
    "terminated on the ground",
    "MAV_CMD_DO_FLIGHTTERMINATION 1, disarmed, and what is accepted afterwards",
    ground=False,
)
def terminated(r: Rig, t: Transcript) -> None:
    t.note("ack", r.command(185, 1))
    r.settle()
    t.note(
        "state after", f"{r.mode} {'armed' if r.armed else 'disarmed'} {r.state['HEARTBEAT'].system_status}"
    )
    t.note("arm after it", r.arm())
    t.note("armed", r.settle().armed)
    t.note("cancelled: ack", r.command(185, 0))
    t.note("cancelled: arm", r.arm())


@case("terminated in the air", "MAV_CMD_DO_FLIGHTTERMINATION 1 while hovering", ground=False)
def terminated_up(r: Rig, t: Transcript) -> None:
    hover(r)
    r.clear()
    t.note("ack", r.command(185, 1))
    r.run(2.0)
    t.note("system_status", r.state["HEARTBEAT"].system_status)
    t.note("mode", r.mode)
    t.note("it falls", bool(r.p_n[2] > -0.8))
    t.note("complains", any(s <= 4 for s, _ in r.texts()))
    t.words("texts", "; ".join(f"{s} {x}" for s, x in r.texts()))
    r.run(5.0)
    t.note("armed after", r.armed)
