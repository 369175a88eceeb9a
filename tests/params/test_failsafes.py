"""Flight tests of the `failsafe` section with the built-in autopilot: each vehicle of a fleet loses one thing.

benchmarks/failsafes.py flies the same cases on a real PX4.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import itertools
import sys
from collections.abc import Callable
from functools import cache
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
LINK_LOSS_S = 7.5
"""The shortest time-out of the data link in PX4 1.16: COM_DL_LOSS_T 5 s, and 2.5 s before it starts."""
LINK_LEAD_S = 5.0
"""The ground station is lost earlier than everything else, so that the flight is shorter."""
AFTER_LOSS_S = 9.0
TELEMETRY_STEPS = 50
"""Telemetry is only read every fiftieth step: the texts of a few vehicles are all that the tests need."""


@dataclasses.dataclass(frozen=True)
class Case:
    """A vehicle of the fleet.

    lost: what it loses.
    section: content of the YAML's `failsafe`.
    after_s: time from the loss to the expected reaction [s]; None: no reaction.
    modes: modes that it enters in flight.
    ends: lands, hovers, comes home or falls.
    more: further YAML.
    """

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
    after_s = None if action == "none" else LINK_LOSS_S - LINK_LEAD_S
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
class Observation:
    """The flight of a vehicle after the loss.

    modes: modes entered in flight.
    reaction_s, cut_s: time of the first reaction, and of stopped motors in flight [s]; None: never.
    down: it reached the floor.
    texts: its STATUSTEXT messages.
    end_n: final position relative to home [m] [NED] (3,).
    """

    modes: list[str] = dataclasses.field(default_factory=list)
    reaction_s: float | None = None
    cut_s: float | None = None
    down: bool = False
    texts: str = ""
    end_n: Any = None


def _flight_module() -> ModuleType:
    """Import tests/autopilot/flight.py, which is in no package."""
    path = Path(__file__).parents[1] / "autopilot" / "flight.py"
    spec = importlib.util.spec_from_file_location("autopilot_flight", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@cache
def generated(folder: Path, case: Case) -> dict[str, float]:
    """Return the parameters with which a built-in vehicle of such an arena starts."""
    path = folder / "arena.yaml"
    path.write_text(f"failsafe: {{{case.section}}}\n{case.more}vehicles:\n  uav1: {{autopilot: builtin}}\n")
    arena = load_arena(path)
    return firmware(arena, arena.vehicles[0]).values


class Fleet:
    """One vehicle per case, in one flight. Programs and the ground station send ten times per second."""

    def __init__(self, folder: Path) -> None:
        self.cases = list(CASES.values())
        size = [20.0, 8.0 * len(self.cases), 20.0]
        self.flight = _flight_module().Flight(
            len(self.cases), size_m=size, physics_hz=250, decoded={mavlink.MAVLINK_MSG_ID_STATUSTEXT}
        )
        self.flight.vision_hz = 30.0
        self.flight.pilots.transmit = self._every_fiftieth(self.flight.pilots.transmit)
        self.lost: float | None = None
        self.link_lost = False
        self.observed = {name: Observation() for name in CASES}
        for i, case in enumerate(self.cases):
            values = {**generated(folder, case), "MAV_SYS_ID": i + 1}
            self.flight.pilots.sticks(i, case.lost == "sticks")
            del values["MPC_THR_HOVER"]  # of another profile
            assert self.flight.pilots.params.load(i, values) == []

    @staticmethod
    def _every_fiftieth(transmit: Callable[[], Any]) -> Callable[[], Any]:
        steps = itertools.count()
        return lambda: () if next(steps) % TELEMETRY_STEPS else transmit()

    def fly(self) -> None:
        """Take off, lose everything, and record what each vehicle does."""
        self._take_off()
        self.lost = self.flight.now
        for i, case in enumerate(self.cases):
            self.flight.vision_on[i] = case.lost != "poses"
            self.flight.pilots.sticks(i, False)
            if case.lost == "charge":
                self.flight.world._battery.remaining[i] = 0.19
        self.flight.run(AFTER_LOSS_S, self._observe)
        for i, s in enumerate(self.observed.values()):
            s.end_n = self.flight.position(i) - [0.0, 2.0 * i, 0.0]
            s.texts = "".join(m.text for m in self.flight.received[i])

    def _take_off(self) -> None:
        flight = self.flight
        for i in range(len(self.cases)):  # a return needs a global position
            flight.send(i, mavlink.MAVLink_set_gps_global_origin_message(i + 1, 503500000, 142500000, 300000))
        flight.until(lambda f: all(v.ready_to_arm for v in f.pilots.vehicles), 20, self._send)
        flight.run(0.4, self._send)
        for command, *numbers in (
            (mavlink.MAV_CMD_DO_SET_MODE, 1, 6),
            (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, 0),
        ):
            for i in range(len(self.cases)):
                flight.send(
                    i, mavlink.MAVLink_command_long_message(i + 1, 1, command, 0, *numbers, 0, 0, 0, 0, 0)
                )
            flight.run(0.1, self._send)
        self.link_lost = True
        flight.run(LINK_LEAD_S, self._send)
        for i, case in enumerate(self.cases):
            assert flight.mode(i) == "OFFBOARD" and abs(flight.position(i)[2] + HEIGHT_M) < 0.1, case
            flight.received.forget(i)

    def _send(self, f: Any) -> None:
        if round(f.now * 50) % 5:
            return
        p_n = f.world.truth().p_n
        for i, case in enumerate(self.cases):
            if self.lost is None or case.lost != "setpoints":
                north, down = NORTH_M if p_n[i, 2] < -1.0 else 0.0, -HEIGHT_M
                if self.lost is not None and case.lost in BEYOND:
                    north, down = BEYOND[case.lost]
                f.setpoint(i, [north, 2.0 * i, down])
            if not self.link_lost or case.lost != "ground station":
                f.send(i, mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))

    def _observe(self, f: Any) -> None:
        self._send(f)
        assert self.lost is not None
        heights = -f.world.truth().p_n[:, 2]
        for i, s in enumerate(self.observed.values()):
            s.down = s.down or bool(heights[i] < FLOOR_M)
            if not s.down:
                _record(s, f.mode(i), f.now - self.lost, stopped=bool(np.max(f.motors[i]) < 0.05))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("failsafes")


@pytest.fixture(scope="module")
def observed(folder: Path) -> dict[str, Observation]:
    fleet = Fleet(folder)
    fleet.fly()
    return fleet.observed


def _record(s: Observation, mode: str, at: float, *, stopped: bool) -> None:
    if stopped and s.cut_s is None:
        s.cut_s = at
    changed = mode != (s.modes or ["OFFBOARD"])[-1] and not (stopped and mode == "AUTO.LOITER")
    if changed:
        s.modes.append(mode)
    if (changed or stopped) and s.reaction_s is None:
        s.reaction_s = at


@pytest.mark.parametrize("name", CASES)
def test_failsafe_reacts_as_configured(observed: dict[str, Observation], name: str) -> None:
    case, s = CASES[name], observed[name]
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


def test_low_battery_is_reported_with_any_action(observed: dict[str, Observation]) -> None:
    assert (
        "Low battery: 19 %" in observed["charge, warn"].texts
        and "Critical battery" in observed["charge, land"].texts
    )
    assert "battery" not in observed["nothing"].texts


def test_built_in_autopilot_has_every_generated_parameter(folder: Path) -> None:
    for case in CASES.values():
        assert Params(1).load(0, generated(folder, case)) == []
