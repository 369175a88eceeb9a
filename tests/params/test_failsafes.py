"""An arena's `failsafe:` section flown by the built-in autopilot: a fleet in which each vehicle loses one thing at one instant.

On the real PX4 the same is flown by benchmarks/failsafes.py.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.autopilot.param_table import Params
from arena.plan.firmware import firmware
from arena.schema import load_arena

pytest.importorskip("pybullet", reason="the simulation room needs pybullet")

HEIGHT_M, FLOOR_M, NORTH_M = 1.2, 0.15, 1.0
LINK_LOSS_S = 8.0


@dataclasses.dataclass(frozen=True)
class Case:
    """lost: what; section: of the YAML; after_s: when the reaction is due; modes: entered in the air; ends: how; more: YAML."""

    lost: str
    section: str
    after_s: float | None
    modes: tuple[str, ...]
    ends: str
    more: str = ""


def _offboard(action: str, after_s: float, modes: tuple[str, ...], ends: str) -> Case:
    return Case(
        "setpoints", f"offboard_loss: {{action: {action}, after_s: {after_s:g}}}", after_s, modes, ends
    )


def _link(action: str, modes: tuple[str, ...], ends: str) -> Case:
    after_s = None if action == "none" else LINK_LOSS_S
    return Case(
        "ground station",
        f"data_link_loss: {{action: {action}, after_s: {LINK_LOSS_S:g}}}",
        after_s,
        modes,
        ends,
    )


def _blind(action: str, offboard: str, modes: tuple[str, ...], ends: str) -> Case:
    section = f"position_loss: {{action: {action}}}, offboard_loss: {{action: {offboard}}}"
    return Case("poses", section, 1.0, modes, ends)


def _sticks(action: str, modes: tuple[str, ...], ends: str) -> Case:
    return Case(
        "sticks", f"rc_loss: {{action: {action}}}", None if action == "none" else 0.5, modes, ends, STICKS
    )


def _fence(lost: str, action: str, after_s: float, modes: tuple[str, ...], ends: str) -> Case:
    return Case(lost, f"geofence: {{action: {action}}}", after_s, modes, ends, FENCE)


STICKS, FENCE = "defaults: {sticks: true}\n", "geofence: {north: [-1.5, 1.5], east: [-1.5, 1.5], up: 1.8}\n"
BEYOND = {"ceiling": [NORTH_M, -4.0], "circle": [6.0, -HEIGHT_M]}
LAND, HOLD, RETURN = ("AUTO.LAND",), ("AUTO.LOITER",), ("AUTO.RTL",)
CASES = {
    "setpoints, land": _offboard("land", 1.0, LAND, "lands"),
    "setpoints, land later": _offboard("land", 2.5, LAND, "lands"),
    "setpoints, hold": _offboard("hold", 1.0, HOLD, "hovers"),
    "setpoints, return": _offboard("return", 1.0, RETURN, "comes home"),
    "setpoints, terminate": _offboard("terminate", 1.0, ("TERMINATION",), "falls"),
    "setpoints, disarm": _offboard("disarm", 1.0, (), "falls"),
    "poses, land": _blind("land", "land", ("DESCEND",), "lands"),
    "poses, land, where setpoints hold": _blind("land", "hold", ("DESCEND",), "lands"),
    "poses, terminate": _blind("terminate", "terminate", ("TERMINATION",), "falls"),
    "poses, disarm": _blind("disarm", "disarm", (), "falls"),
    "charge, land": Case("charge", "low_battery: {warn: 0.3, land: 0.2}", 0.0, LAND, "lands"),
    "charge, warn": Case("charge", "low_battery: {warn: 0.3, land: null}", None, (), "hovers"),
    "ground station, none": _link("none", (), "hovers"),
    "ground station, land": _link("land", LAND, "lands"),
    "ground station, hold": _link("hold", HOLD, "hovers"),
    "ground station, return": _link("return", RETURN, "comes home"),
    "ground station, disarm": _link("disarm", (), "falls"),
    "sticks, none": _sticks("none", (), "hovers"),
    "sticks, land": _sticks("land", LAND, "lands"),
    "sticks, hold": _sticks("hold", HOLD, "hovers"),
    "sticks, return": _sticks("return", RETURN, "comes home"),
    "sticks, terminate": _sticks("terminate", ("TERMINATION",), "falls"),
    "sticks, disarm": _sticks("disarm", (), "falls"),
    "ceiling, land": _fence("ceiling", "land", 0.6, LAND, "lands"),
    "ceiling, terminate": _fence("ceiling", "terminate", 0.6, ("TERMINATION",), "falls"),
    "circle, return": _fence("circle", "return", 0.9, RETURN, "comes home"),
    "nothing": Case("nothing", "offboard_loss: {action: land}", None, (), "hovers"),
}


@dataclasses.dataclass
class Seen:
    """What a vehicle did from the loss on [s]; modes in the air; cut_s: motors stopped there."""

    modes: list[str] = dataclasses.field(default_factory=list)
    reaction_s: float | None = None
    cut_s: float | None = None
    down: bool = False
    texts: str = ""
    end_n: Any = None


def _flight_module() -> ModuleType:
    """tests/autopilot/flight.py, which is no package's."""
    path = Path(__file__).parents[1] / "autopilot" / "flight.py"
    spec = importlib.util.spec_from_file_location("autopilot_flight", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def generated(folder: Path, case: Case) -> dict[str, float]:
    """The parameters that a built-in vehicle of such an arena starts from."""
    path = folder / "arena.yaml"
    path.write_text(f"failsafe: {{{case.section}}}\n{case.more}vehicles:\n  uav1: {{autopilot: builtin}}\n")
    arena = load_arena(path)
    return firmware(arena, arena.vehicles[0]).values


class Fleet:
    """One vehicle a case, in one flight; what their programs say comes ten times a second."""

    def __init__(self, folder: Path) -> None:
        self.cases = list(CASES.values())
        self.flight = _flight_module().Flight(len(self.cases), size_m=[20.0, 8.0 * len(self.cases), 20.0])
        self.lost: float | None = None
        self.found = {name: Seen() for name in CASES}
        silent = mavlink.MAVLink(None)
        silent.parse_buffer = lambda data: []  # reading what all say would take longer than flying
        for i, case in enumerate(self.cases):
            if case.lost not in ("charge", "nothing"):
                self.flight._parsers[i] = silent
            values = {**generated(folder, case), "MAV_SYS_ID": i + 1}
            self.flight.pilots.sticks(i, case.lost == "sticks")
            del values["MPC_THR_HOVER"]  # of another profile
            assert self.flight.pilots.params.load(i, values) == []

    def fly(self) -> None:
        self._take_off()
        self.lost = self.flight.now
        for i, case in enumerate(self.cases):
            self.flight.vision_on[i] = case.lost != "poses"
            self.flight.pilots.sticks(i, False)
            if case.lost == "charge":
                self.flight.world._battery.remaining[i] = 0.19
        self.flight.run(LINK_LOSS_S + 8.0, self._look)
        for i, s in enumerate(self.found.values()):
            s.end_n = self.flight.position(i) - [0.0, 2.0 * i, 0.0]
            s.texts = "".join(m.text for m in self.flight.heard[i] if m.get_type() == "STATUSTEXT")

    def _take_off(self) -> None:
        flight = self.flight
        for i in range(len(self.cases)):  # a return wants a place on the globe
            flight.send(i, mavlink.MAVLink_set_gps_global_origin_message(i + 1, 503500000, 142500000, 300000))
        flight.until(lambda f: all(v.ready_to_arm for v in f.pilots.vehicles), 20, self._speak)
        flight.run(0.4, self._speak)
        for command, *numbers in (
            (mavlink.MAV_CMD_DO_SET_MODE, 1, 6),
            (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0),
        ):
            for i in range(len(self.cases)):
                flight.send(
                    i, mavlink.MAVLink_command_long_message(i + 1, 1, command, 0, *numbers, 0, 0, 0, 0, 0)
                )
            flight.run(0.1, self._speak)
        flight.run(6.0, self._speak)
        for i, case in enumerate(self.cases):
            assert flight.mode(i) == "OFFBOARD" and abs(flight.position(i)[2] + HEIGHT_M) < 0.1, case
            flight.heard[i].clear()

    def _speak(self, f: Any) -> None:
        if round(f.now * 50) % 5:
            return
        p_n = f.world.truth().p_n
        for i, case in enumerate(self.cases):
            if self.lost is None or case.lost != "setpoints":
                north, down = NORTH_M if p_n[i, 2] < -1.0 else 0.0, -HEIGHT_M
                if self.lost is not None and case.lost in BEYOND:
                    north, down = BEYOND[case.lost]
                f.setpoint(i, [north, 2.0 * i, down])
            if self.lost is None or case.lost != "ground station":
                f.send(i, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))

    def _look(self, f: Any) -> None:
        self._speak(f)
        assert self.lost is not None
        heights = -f.world.truth().p_n[:, 2]
        for i, s in enumerate(self.found.values()):
            s.down = s.down or bool(heights[i] < FLOOR_M)
            if not s.down:
                _note(s, f.mode(i), f.now - self.lost, stopped=bool(np.max(f.motors[i]) < 0.05))


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Seen]:
    fleet = Fleet(tmp_path_factory.mktemp("failsafes"))
    fleet.fly()
    return fleet.found


def _note(s: Seen, mode: str, at: float, *, stopped: bool) -> None:
    if stopped and s.cut_s is None:
        s.cut_s = at
    changed = mode != (s.modes or ["OFFBOARD"])[-1] and not (stopped and mode == "AUTO.LOITER")
    if changed:
        s.modes.append(mode)
    if (changed or stopped) and s.reaction_s is None:
        s.reaction_s = at


@pytest.mark.parametrize("name", CASES)
def test_each_failsafe_of_the_yaml_does_what_it_says(seen: dict[str, Seen], name: str) -> None:
    case, s = CASES[name], seen[name]
    assert tuple(s.modes) == case.modes
    if case.after_s is None:
        assert s.reaction_s is None
    else:  # simulated time; COM_DL_LOSS_T is whole seconds
        assert s.reaction_s is not None and case.after_s - 0.25 <= s.reaction_s <= case.after_s + 0.6
    assert (s.cut_s is not None) == (case.ends == "falls")
    assert s.down == (case.ends != "hovers")
    if case.ends == "hovers":
        assert abs(s.end_n[2] + HEIGHT_M) < 0.2 and abs(s.end_n[0] - NORTH_M) < 0.3
    elif case.ends == "comes home":
        assert np.hypot(*s.end_n[:2]) < 0.45
    elif case.ends == "lands" and case.lost != "poses":
        assert abs(s.end_n[0] - NORTH_M) < 0.3


def test_an_empty_battery_is_told_whatever_it_does(seen: dict[str, Seen]) -> None:
    assert (
        "Low battery: 19 %" in seen["charge, warn"].texts and "Critical battery" in seen["charge, land"].texts
    )
    assert "battery" not in seen["nothing"].texts


def test_every_parameter_that_a_failsafe_becomes_is_known_to_the_built_in_autopilot(tmp_path: Path) -> None:
    for case in CASES.values():
        assert Params(1).load(0, generated(tmp_path, case)) == []
