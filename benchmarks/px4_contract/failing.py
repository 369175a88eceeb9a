"""Cases of failsafes: trigger, delay, reaction of the vehicle, and end of the flight."""

from __future__ import annotations

import numpy as np

from arena.wire.px4_mode import mode_words
from px4_contract.flying import hover, watch_modes
from px4_contract.params import FLOAT, INT, packed, write
from px4_contract.registry import case
from px4_contract.rig import Rig, Setup
from px4_contract.transcript import Transcript


def outcome(r: Rig, t: Transcript, seconds: float = 20.0, key: str = "") -> None:
    """Record what follows a fault: each mode with its time, the final state, and texts by severity."""
    begin, lowest, mode = r.now, 0.0, r.mode
    changed: list[tuple[float, str]] = []
    while r.now - begin < seconds and (r.armed or r.p_n[2] < -0.1):
        r.tick()
        if r.mode != mode:
            mode = r.mode
            changed.append((r.now - begin, mode))
        lowest = min(lowest, float(r.p_n[2]))
    over = r.now - begin
    # The heartbeat tells of disarming up to a second later than CURRENT_MODE of the mode that comes with it.
    flown = [(at, name) for at, name in changed if r.armed or at < over - 1.1]
    t.note(f"{key}modes", ", ".join(name for _, name in flown) or "no change")
    for at, name in flown:
        t.number(f"{key}{name} after", at, near=0.8, part=0.25, unit="s")
    if not r.armed:
        t.number(f"{key}disarmed after", over, near=1.3, part=0.25, unit="s")
        t.note(f"{key}mode after disarming", r.settle().mode)
    t.note(f"{key}on the floor in the end", bool(r.p_n[2] > -0.1))
    t.note(f"{key}armed in the end", r.armed)
    t.number(f"{key}highest", -lowest, near=0.5, part=0.2, unit="m")
    speed = float(np.linalg.norm(r.truth().v_n[0][:2]))
    t.number(f"{key}sideways speed in the end", speed, near=0.4, part=0.3, unit="m/s")
    texts = r.texts()
    t.note(f"{key}complains", any(s <= 4 for s, _ in texts))
    t.words(f"{key}texts", "; ".join(f"{s} {x}" for s, x in texts))


def _watch(r: Rig) -> None:
    """Request CURRENT_MODE at a high rate, because HEARTBEAT (1 Hz, fixed) is too slow to measure times."""
    r.command(511, 436, 50_000)
    r.command(511, 245, 100_000)


OFFBOARD_LOST = {
    0: "position",
    1: "altitude",
    2: "stabilized",
    3: "return",
    4: "land",
    5: "hold",
    6: "terminate",
    7: "disarm",
}


def _offboard_lost(action: int, wait_s: float) -> None:
    name = f"offboard lost, action {action} ({OFFBOARD_LOST[action]}), wait {wait_s:g} s"

    @case(
        name,
        "the setpoints stop while it hovers",
        ground=False,
        setup=Setup(params={"COM_OBL_RC_ACT": action, "COM_FAIL_ACT_T": wait_s}),
    )
    def run(r: Rig, t: Transcript) -> None:
        hover(r)
        _watch(r)
        r.clear()
        r.each.clear()
        outcome(r, t)


for _action in OFFBOARD_LOST:
    _offboard_lost(_action, 0.0)
for _action in (4, 5, 0):
    _offboard_lost(_action, 5.0)


@case(
    "offboard lost and found",
    "the setpoints stop and return: it stays in the failsafe until a mode is requested",
    ground=False,
)
def lost_and_found(r: Rig, t: Transcript) -> None:
    hover(r)
    _watch(r)
    kept = list(r.each)
    r.clear()
    r.each.clear()
    t.number("leaves OFFBOARD after", r.until(lambda r: r.mode != "OFFBOARD", 5.0), near=0.4, unit="s")
    t.note("mode", r.mode)
    r.each[:] = kept
    r.run(1.0)
    t.note("with setpoints again", r.mode)
    t.note("asked: ack", r.set_mode(6))
    t.note("asked: mode", r.mode)
    r.run(3.0)
    t.number("height", -r.p_n[2], near=0.3, unit="m")
    for gap in (0.3, 0.6, 0.9):
        r.each.clear()
        r.run(gap)
        r.each[:] = kept
        r.run(1.0)
        t.note(f"a gap of {gap:g} s: mode", r.mode)
    r.each.clear()
    outcome(r, t, key="at last: ")


@case(
    "offboard left by rule",
    "the setpoints of a hovering vehicle become invalid: unknown frame, no values, NaN",
    ground=False,
)
def left_by_rule(r: Rig, t: Transcript) -> None:
    from px4_contract.offboard import POSITION, local

    hover(r)
    _watch(r)
    kept = list(r.each)
    for key, say in (
        ("unknown frame", local(POSITION, p=(0, 0, -1.5), frame=99)),
        ("all nan", local(POSITION, p=(float("nan"),) * 3)),
        ("all ignored", local(0xFFF)),
    ):
        r.each[:] = [say]
        r.clear()
        took = r.until(lambda r: r.mode != "OFFBOARD", 4.0)
        t.number(f"{key}: leaves OFFBOARD after", took, near=0.5, unit="s")
        t.note(f"{key}: mode", r.mode)
        r.each[:] = kept
        r.run(0.2)
        r.set_mode(6)
        r.until(lambda r: abs(r.p_n[2] + 1.5) < 0.2, 8.0)


def _vision_lost(mode: str, main: int, sub: int) -> None:
    @case(f"poses lost in {mode}", "the poses stop while it hovers", ground=False)
    def run(r: Rig, t: Transcript) -> None:
        hover(r)
        if main != 6:
            r.set_mode(main, sub)
            r.each.clear()
        r.run(1.0)
        _watch(r)
        r.clear()
        r.poses = False
        outcome(r, t, 25.0)


_vision_lost("OFFBOARD", 6, 0)
_vision_lost("HOLD", 4, 3)
_vision_lost("LAND", 4, 6)


@case("poses lost and found", "the poses stop for two seconds while it hovers", ground=False)
def poses_back(r: Rig, t: Transcript) -> None:
    hover(r)
    _watch(r)
    r.clear()
    for gap in (0.3, 0.7, 2.0):
        r.poses = False
        r.run(gap)
        r.poses = True
        r.run(3.0)
        t.note(f"{gap:g} s: mode", r.mode)
        t.note(f"{gap:g} s: armed", r.armed)
    outcome(r, t, 15.0)


def _data_link(action: int) -> None:
    @case(
        f"data link lost, NAV_DLL_ACT {action}",
        "the heartbeats of the ground station stop while it hovers in OFFBOARD",
        ground=False,
    )
    def run(r: Rig, t: Transcript) -> None:
        hover(r)
        write(
            r, "NAV_DLL_ACT", packed(action), INT
        )  # in the air: while PX4 boots nobody is heard, and 5 terminates it there
        _watch(r)
        r.clear()
        r.gcs = False
        outcome(r, t, 30.0)


for _action in (0, 1, 2, 3, 5):
    _data_link(_action)


@case(
    "data link never there",
    "armed with NAV_DLL_ACT 3; there was never a ground station",
    ground=False,
    setup=Setup(params={"NAV_DLL_ACT": 3}),
)
def never_linked(r: Rig, t: Transcript) -> None:
    r.gcs = False
    r.run(14.0)
    r.clear()
    t.note("may arm", r.may_arm)
    t.note("arm: ack", r.arm())
    t.note("armed", r.armed)


DRAIN = Setup(params={"SIM_BAT_DRAIN": 40.0}, profile={"battery": {"capacity_mah": 220.0}})


def _battery(action: int) -> None:
    setup = Setup(params={**DRAIN.params, "COM_LOW_BAT_ACT": action}, profile=DRAIN.profile)

    @case(
        f"battery empties, COM_LOW_BAT_ACT {action}",
        "a small battery empties while it hovers",
        ground=False,
        setup=setup,
    )
    def run(r: Rig, t: Transcript) -> None:
        hover(r)
        _watch(r)
        r.command(511, 1, 100_000)
        begin = len(r.received)
        modes: list[str] = []
        levels: list[int] = []
        left: dict[str, int] = {}
        ended = r.until(lambda r: not r.armed or r.state["SYS_STATUS"].battery_remaining <= 0, 90.0)
        remaining = 100
        for h in r.received[begin:]:
            if h.name == "SYS_STATUS":
                remaining = h.m.battery_remaining
            elif (
                h.name == "HEARTBEAT"
                and h.m is not None
                and (word := mode_words(h.m.custom_mode)) not in modes[-1:]
            ):
                modes.append(word)
                left[word] = remaining
            elif h.name == "STATUSTEXT" and h.m.severity <= 4:
                levels.append(remaining)
        t.note("ended by itself", ended is not None)
        t.note("modes", ", ".join(modes))
        for word, percent in left.items():
            if word != modes[0]:
                t.number(f"{word} at", percent, near=4, unit="%")
        # PX4 repeats its warnings, each time at another charge.
        about = [str(round(x / 5) * 5) for x in levels]
        t.note("first warning at about", about[0] if about else "none")
        t.words("warnings at about", " ".join(about))
        t.words("texts", "; ".join(f"{s} {x}" for s, x in r.texts()))
        t.note("in the end", "disarmed" if not r.armed else "armed")


for _action in (0, 2, 3):
    _battery(_action)


@case(
    "hit and turned over",
    "the attitude goes beyond the limit with CBRK_FLIGHTTERM 0",
    ground=False,
    setup=Setup(params={"CBRK_FLIGHTTERM": 0}),
)
def turned_over(r: Rig, t: Transcript) -> None:
    from px4_contract.offboard import attitude

    hover(r, 6.0)
    _watch(r)
    r.clear()
    r.each[:] = [attitude(0b10000000, rates=(6.0, 0, 0), thrust=0.5)]
    outcome(r, t, 6.0)
    t.note("system_status", r.state["HEARTBEAT"].system_status)


@case("poses jump", "the poses move by 0.3 m, then by 3 m, while it hovers", ground=False)
def jump(r: Rig, t: Transcript) -> None:
    hover(r)
    _watch(r)
    r.clear()
    for shift in (0.3, 3.0):
        r.shift[:] = (shift, 0.0, 0.0)
        outcome(r, t, 6.0, key=f"{shift:g} m: ")
        t.number(f"{shift:g} m: is north by", float(r.p_n[0]), near=0.5, part=0.3, unit="m")


def _parameters_in_flight() -> None:
    @case(
        "parameters in flight",
        "COM_OBL_RC_ACT and MPC_XY_VEL_MAX written while it hovers take effect",
        ground=False,
    )
    def run(r: Rig, t: Transcript) -> None:
        from px4_contract.params import INT

        hover(r)
        _watch(r)
        t.note("COM_OBL_RC_ACT", write(r, "COM_OBL_RC_ACT", packed(5), INT))
        t.note("COM_OF_LOSS_T", write(r, "COM_OF_LOSS_T", 2.0, FLOAT))
        r.clear()
        r.each.clear()
        outcome(r, t, 8.0)


_parameters_in_flight()
__all__ = ["outcome", "watch_modes"]
