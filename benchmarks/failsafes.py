"""The `failsafe:` section in flight: each loss with each action, compared with the YAML.

python benchmarks/failsafes.py [--autopilot px4|builtin|both] [--case PATTERN ...]

Each flight starts one vehicle in its own world, from the plan of an arena.yaml with the section under test: the generated parameters
fly. The vehicle hovers in OFFBOARD 2 m north of its home and 1.5 m high; then the loss happens. All times are simulated. Prints
a table in Markdown. Exit code 1: a flight does not react as the YAML says.
"""

from __future__ import annotations

import argparse
import math
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

import numpy as np
from px4_contract.flying import hover
from px4_contract.rig import Rig, Setup, Unfit, vehicle

from arena.schema.px4 import find_px4

HEIGHT_M, NORTH_M = 1.5, 2.0
FLOOR_M = 0.1
STOPPED = 0.05
"""Motor command below which the motors count as stopped."""
NEAR_M = 0.7
BOX_M, CEILING_M = 3.0, 2.0
"""Geofence of its cases: distance of the walls from the centre, and height."""
HIGH_M = 10.0
"""Height at which a rotor is lost."""
EARLY_S, LATE_S = 0.6, 1.2
"""Tolerances of the reaction time: the last heartbeat of a ground station is up to 0.5 s old, and PX4 1.16 reacts to
missing poses 0.4 s before EKF2_NOAID_TOUT."""
WATCHED_S = 30.0
CURRENT_MODE, SYS_STATUS, SET_INTERVAL = 436, 1, 511


@dataclass(kw_only=True)
class Reaction:
    """The observed reaction. Times count from the loss [s]; None: it did not happen.

    modes: in order, while in the air. cut_s: motors stopped in the air. highest_m: greatest height. moved_m, from_home_m:
    horizontal distances at the end. charge: battery at the reaction [%], or at the end without one.
    """

    modes: list[str] = field(default_factory=list)
    mode_s: float | None = None
    cut_s: float | None = None
    down_s: float | None = None
    armed: bool = True
    height_m: float = 0.0
    highest_m: float = 0.0
    moved_m: float = 0.0
    from_home_m: float = 0.0
    charge: int = 100
    warned: bool = False

    @property
    def reaction_s(self) -> float | None:
        times = [t for t in (self.mode_s, self.cut_s) if t is not None]
        return min(times) if times else None


Wanted = Callable[[Reaction], bool]


def _lands(s: Reaction) -> bool:
    return (
        s.modes == ["AUTO.LAND"]
        and s.cut_s is None
        and s.down_s is not None
        and not s.armed
        and s.moved_m < NEAR_M
    )


def _descends(s: Reaction) -> bool:
    """Return whether it landed; a blind landing may drift."""
    return _lands(Reaction(**{**s.__dict__, "moved_m": min(s.moved_m, s.moved_m / 4)}))


def _holds(s: Reaction) -> bool:
    return s.modes == ["AUTO.LOITER"] and s.armed and abs(s.height_m - HEIGHT_M) < 0.3 and s.moved_m < NEAR_M


def _returns(s: Reaction) -> bool:
    return s.modes[:1] == ["AUTO.RTL"] and s.down_s is not None and not s.armed and s.from_home_m < NEAR_M


def _stops(s: Reaction) -> bool:
    """Return whether it fell: motors off in the air, on the floor within 1 s."""
    return s.cut_s is not None and s.down_s is not None and s.down_s - s.cut_s < 1.0


def _disarms(s: Reaction) -> bool:
    return _stops(s) and not s.armed


def _goes_on(s: Reaction) -> bool:
    return not s.modes and s.cut_s is None and s.armed and abs(s.height_m - HEIGHT_M) < 0.3


def _climbs_on(s: Reaction) -> bool:
    return not s.modes and s.cut_s is None and s.armed and s.height_m > CEILING_M + 0.3


def _holds_there(s: Reaction) -> bool:
    return s.modes == ["AUTO.LOITER"] and s.cut_s is None and s.armed and s.down_s is None


def _lands_there(s: Reaction) -> bool:
    """Return whether it landed after braking."""
    return _lands(Reaction(**{**s.__dict__, "moved_m": s.moved_m / 4.0}))


def _tumbles(s: Reaction) -> bool:
    return not s.modes and s.cut_s is None and s.down_s is not None


def _warns(s: Reaction) -> bool:
    return _goes_on(s) and s.warned


ACTIONS: dict[str, Wanted] = {
    "land": _lands,
    "hold": _holds,
    "return": _returns,
    "terminate": _stops,
    "disarm": _disarms,
    "none": _goes_on,
    "warn": _warns,
}


@dataclass(frozen=True, kw_only=True)
class Flight:
    """One case. lost: the loss. action: of the YAML. after_s: expected time of the reaction, None without one. yaml: the section."""

    lost: str
    action: str
    after_s: float | None
    yaml: str
    lose: Callable[[Rig], Any]
    wanted: Wanted
    setup: dict[str, Any] = field(default_factory=dict)
    sticks: bool = False
    height_m: float = HEIGHT_M

    @property
    def name(self) -> str:
        return f"{self.lost}: {self.action}"


class Row(NamedTuple):
    flight: Flight
    autopilot: str
    seen: Reaction | None
    why: str

    @property
    def right(self) -> bool:
        s, due = self.seen, self.flight.after_s
        if s is None or not self.flight.wanted(s):
            return False
        return due is None or (s.reaction_s is not None and due - EARLY_S <= s.reaction_s <= due + LATE_S)


# -- losses --------------------------------------------------------------------------------------------------------------


def _setpoints(r: Rig) -> None:
    r.each.clear()


def _poses(r: Rig) -> None:
    r.poses = False


def _radio(r: Rig) -> None:
    r.sticks = False


def _ground_station(r: Rig) -> None:
    r.gcs = False


def _charge(percent: int) -> Callable[[Rig], None]:
    def lose(r: Rig) -> None:
        if (
            r.until(
                lambda r: r.state["SYS_STATUS"].battery_remaining <= percent or r.mode != "OFFBOARD", 150.0
            )
            is None
        ):
            raise Unfit("the battery does not discharge")

    return lose


def _climb(r: Rig) -> None:
    """Fly through the ceiling of the fence."""
    r.each[:] = [r.position(NORTH_M, 0.0, -2.0 * CEILING_M)]
    if r.until(lambda r: -r.p_n[2] >= CEILING_M, 10.0) is None:
        raise Unfit("it does not reach the ceiling")


def _go_north(r: Rig) -> None:
    """Fly through the circle around the fence's box."""
    r.each[:] = [r.position(2.0 * BOX_M, 0.0, -HEIGHT_M)]
    if r.until(lambda r: r.p_n[0] >= math.hypot(BOX_M, BOX_M), 15.0) is None:
        raise Unfit("it does not reach the circle")


def _rotor(r: Rig) -> None:
    r.lose_rotor(1)


SMALL = {"params": {"SIM_BAT_DRAIN": 100.0}, "profile": {"battery": {"capacity_mah": 550.0}}}
"""Battery that is empty after 100 s of hover, in both simulations."""


def flights() -> list[Flight]:
    def section(key: str, action: str, after_s: float | None = None) -> str:
        after = "" if after_s is None else f", after_s: {after_s:g}"
        return f"failsafe: {{{key}: {{action: {action}{after}}}}}\n"

    found = [
        Flight(
            lost="setpoints",
            action=action,
            after_s=after_s,
            yaml=section("offboard_loss", action, after_s),
            lose=_setpoints,
            wanted=ACTIONS[action],
        )
        for action, after_s in (
            ("land", 1.0),
            ("hold", 2.0),
            ("return", 1.0),
            ("terminate", 1.0),
            ("disarm", 1.0),
        )
    ]
    found += [
        Flight(
            lost="poses",
            action="land",
            after_s=after_s,
            yaml=section("position_loss", "land", after_s),
            lose=_poses,
            wanted=_descends,
        )
        for after_s in (1.0, 3.0)
    ]
    both = "failsafe:\n  position_loss: {{action: {0}}}\n  offboard_loss: {{action: {0}}}\n"
    found += [
        Flight(
            lost="poses",
            action=action,
            after_s=1.0,
            yaml=both.format(action),
            lose=_poses,
            wanted=ACTIONS[action],
        )
        for action in ("terminate", "disarm")
    ]
    found += [
        Flight(
            lost="charge",
            action="land at 7 %",
            after_s=0.0,
            yaml="failsafe: {low_battery: {land: 0.07}}\n",
            lose=_charge(7),
            wanted=_lands,
            setup=SMALL,
        ),
        Flight(
            lost="charge",
            action="land at 30 %",
            after_s=0.0,
            yaml="failsafe: {low_battery: {warn: 0.5, land: 0.3}}\n",
            lose=_charge(30),
            wanted=_lands,
            setup=SMALL,
        ),
        Flight(
            lost="charge",
            action="warn only",
            after_s=None,
            yaml="failsafe: {low_battery: {land: null}}\n",
            lose=_charge(3),
            wanted=_warns,
            setup=SMALL,
        ),
    ]
    found += [
        Flight(
            lost="RC",
            action=action,
            after_s=None if action == "none" else 0.5,
            yaml=section("rc_loss", action),
            lose=_radio,
            wanted=ACTIONS[action],
            sticks=True,
        )
        for action in ("none", "land", "return", "hold", "terminate", "disarm")
    ]
    found += [
        Flight(
            lost="ground station",
            action=action,
            after_s=None if action == "none" else 10.0,
            yaml=section("data_link_loss", action, 10.0),
            lose=_ground_station,
            wanted=ACTIONS[action],
        )
        for action in ("none", "land", "hold", "return", "disarm")
    ]
    box = f"geofence: {{north: [-{BOX_M}, {BOX_M}], east: [-{BOX_M}, {BOX_M}], up: {CEILING_M}}}\n"
    found += [
        Flight(
            lost="through the fence's ceiling",
            action=action,
            after_s=None if action == "warn" else 0.0,
            yaml=box + section("geofence", action),
            lose=_climb,
            wanted=wanted,
        )
        for action, wanted in (
            ("warn", _climbs_on),
            ("land", _lands_there),
            ("hold", _holds_there),
            ("return", _returns),
            ("terminate", _stops),
        )
    ]
    found += [
        Flight(
            lost="out of the fence's circle",
            action=action,
            after_s=0.0,
            yaml=box + section("geofence", action),
            lose=_go_north,
            wanted=wanted,
        )
        for action, wanted in (("land", _lands_there), ("return", _returns))
    ]
    found += [
        Flight(
            lost="a rotor",
            action=action,
            after_s=None if action == "none" else 0.5,
            yaml=section("attitude", action),
            lose=_rotor,
            wanted=wanted,
            height_m=HIGH_M,
        )
        for action, wanted in (("none", _tumbles), ("terminate", _stops))
    ]
    return found


# -- flying --------------------------------------------------------------------------------------------------------------------


def fly(flight: Flight, autopilot: str, given: argparse.Namespace) -> Row:
    setup = Setup(yaml=flight.yaml, sticks=flight.sticks, **flight.setup)
    try:
        with vehicle(autopilot, setup, address=given.address, number=given.id, speed=given.speed) as r:
            hover(r, flight.height_m)
            r.each[:] = [r.position(NORTH_M, 0.0, -flight.height_m)]
            r.run(5.0)
            for message, every_us in ((CURRENT_MODE, 50_000), (SYS_STATUS, 100_000)):
                r.command(SET_INTERVAL, message, every_us)
            r.clear()
            begin = r.now
            flight.lose(r)
            level = r.state["SYS_STATUS"].battery_remaining
            if r.now > begin:  # a gradual loss counts from its end
                begin = r.now
            return Row(
                flight, autopilot, watch(r, begin, 4.0 if flight.lost == "charge" else 14.0, level), ""
            )
    except Unfit as error:
        return Row(flight, autopilot, None, str(error)[-300:])


def watch(r: Rig, begin: float, quiet_s: float, level: int) -> Reaction:
    """Observe until the vehicle is disarmed and down, for quiet_s after the last change, or for WATCHED_S."""
    s, start, last, down = Reaction(charge=level), r.p_n.copy(), r.now, False
    mode = "OFFBOARD"
    while r.now - begin < WATCHED_S and r.now - last < quiet_s:
        at, truth = r.now - begin, r.truth()
        flies = truth.p_n[0][2] < -2.0 * FLOOR_M
        s.highest_m = max(s.highest_m, -float(truth.p_n[0][2]))
        if flies and r.mode != mode:
            mode, last = r.mode, r.now
            s.modes.append(mode)
            s.mode_s = at if s.mode_s is None else s.mode_s
        if flies and s.cut_s is None and float(np.max(truth.motors[0])) < STOPPED:
            s.cut_s, last = at, r.now
        if not flies and not down and truth.p_n[0][2] > -FLOOR_M:
            down, s.down_s, last = True, at, r.now
        if flies and math.hypot(*truth.v_n[0]) > 0.3:
            last = r.now
        if down and not r.armed:
            break
        r.tick()
    r.settle()
    s.armed, s.height_m = r.armed, -float(r.p_n[2])
    s.moved_m, s.from_home_m = float(np.linalg.norm((r.p_n - start)[:2])), float(np.linalg.norm(r.p_n[:2]))
    s.warned = any(severity <= 4 and "batt" in text.lower() for severity, text in r.texts())
    return s


# -- report -------------------------------------------------------------------------------------------------------------------


def table_line(row: Row) -> str:
    """Return one line of the table."""
    s, f = row.seen, row.flight
    if s is None:
        cells = [f.lost, f.action, row.autopilot, "did not fly", "", "", "no"]
    else:
        happened = ", ".join(s.modes) or ("goes on" if s.cut_s is None else "")
        happened += "" if s.cut_s is None else (", " if happened else "") + "motors off"
        end = f"{s.height_m:.1f} m high" if s.down_s is None else f"down after {s.down_s:.1f} s"
        end += "" if s.down_s is None else ", armed" if s.armed else ", disarmed"
        if f.lost == "charge":
            happened += f" at {s.charge} %" + (", warned" if s.warned else "")
        if f.lose is _climb:
            happened += f", up to {s.highest_m:.1f} m"
        reaction = "" if s.reaction_s is None else f"{s.reaction_s:.2f}"
        cells = [f.lost, f.action, row.autopilot, happened, reaction, end, "yes" if row.right else "no"]
    return "| " + " | ".join(cells) + " |"


def main() -> int:
    given = _arguments()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # end the world and PX4 too
    autopilots = ("px4", "builtin") if given.autopilot == "both" else (given.autopilot,)
    chosen = [f for f in flights() if not given.case or any(fnmatchcase(f.name, p) for p in given.case)]
    print("| loss | action in the YAML | autopilot | reaction | after [s] | end | as configured |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    wrong = []
    for flight in chosen:
        for autopilot in autopilots:
            row = fly(flight, autopilot, given)
            print(table_line(row), flush=True)
            if not row.right:
                wrong.append(row)
    for row in wrong:
        print(f"{row.flight.name}, {row.autopilot}: {row.why or row.seen}", file=sys.stderr)
    return 1 if wrong or not chosen else 0


def _arguments() -> argparse.Namespace:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument(
        "--autopilot", choices=("px4", "builtin", "both"), help="default: both if a PX4 is found"
    )
    options.add_argument(
        "--case", action="append", default=[], metavar="PATTERN", help="fly only these, such as `poses: *`"
    )
    options.add_argument("--speed", default="5", help="of the simulation; the script is in lockstep with it")
    options.add_argument("--address", default="127.77.0.2")
    options.add_argument(
        "--id", type=int, default=82, help="of the vehicle: its system id, ports and PX4 instance"
    )
    given = options.parse_args()
    given.autopilot = given.autopilot or ("both" if find_px4(None) else "builtin")
    return given


if __name__ == "__main__":
    sys.exit(main())
