"""The commander's shortcut for a calm flight: it changes no state, text or event."""

from __future__ import annotations

import dataclasses
import random
from typing import Any

from arena.autopilot.commander import Commander
from arena.autopilot.commander_inputs import CommanderInputs, CommanderParams
from arena.autopilot.flight_modes import Mode
from arena.autopilot.manual_control import NOTHING_RECEIVED, ManualInput
from arena.wire.sticks import CENTRED, Sticks

SEQUENCES, STEPS, PERIOD_S = 150, 200, 0.02
NAN = float("nan")
FIELDS = [field.name for field in dataclasses.fields(Commander)]
DISTURBED: dict[str, tuple[Any, ...]] = {
    "xy_valid": (False,),
    "z_valid": (False,),
    "yaw_valid": (False,),
    "landed": (True,),
    "flying": (False,),
    "tilt_rad": (1.04, 1.05, 1.2, NAN),
    "battery": (0.4, 0.15, 0.14, 0.07, 0.01, NAN),
    "offboard_age": (0.99, 1.0, 1.5, NAN),
    "offboard_needs_position": (False,),
    "gcs_age": (99.0,),
    "global_ok": (False,),
    "home_ok": (False,),
    "mission_ok": (True,),
    "fence": ("Maximum distance from home exceeded",),
    "manual": (
        ManualInput(),
        ManualInput(sticks=CENTRED),
        ManualInput(sticks=Sticks(roll=1.0, pitch=0.0, yaw=0.0, throttle=0.0), speed=2.0),
        ManualInput(sticks=CENTRED, gesture="disarm"),
    ),
}
"""Input of the commander -> values that are not those of a calm flight."""


class WithoutShortcut(Commander):
    """Commander that runs every rule in every step."""

    def _is_calm(self, s: CommanderInputs, params: CommanderParams) -> bool:
        return False


def random_params(rng: random.Random) -> CommanderParams:
    return CommanderParams(
        com_of_loss_t=1.0,
        com_obl_rc_act=rng.choice((0, 1, 2, 3, 4, 5, 6, 7)),
        com_fail_act_t=rng.choice((0.0, 0.05, 0.5)),
        com_disarm_land=rng.choice((0.0, 0.1, 2.0)),
        com_disarm_prflt=rng.choice((0.0, 0.2)),
        com_low_bat_act=rng.choice((0, 2, 3)),
        bat_low_thr=rng.choice((0.15, 0.15, 0.01)),
        bat_crit_thr=0.07,
        bat_emergen_thr=rng.choice((0.05, 0.5)),
        nav_dll_act=rng.choice((0, 0, 0, 0, 0, 0, 1, 2, 3, 5, 6)),
        com_dl_loss_t=10.0,
        cbrk_flightterm=rng.choice((0, 121212, 121212, 121212)),
        fd_fail_rad=rng.choice((1.05, float("inf"))),
        fd_fail_s=0.1,
        gf_action=rng.choice((0, 1, 2, 3, 4, 5)),
        nav_rcl_act=rng.choice((0, 1, 2, 3, 5, 6)),
        com_posctl_navl=rng.choice((0, 1)),
        stick_speed=rng.choice((0.3, 0.3, 0.3, -0.1)),
        lockdown_s=rng.choice((0.0, 1.0)),
    )


def request(c: Commander, what: tuple[str, Mode], s: CommanderInputs, params: CommanderParams) -> None:
    """Run one request of a client."""
    kind, mode = what
    if kind == "mode":
        c.request_mode(mode, s, params)
    elif kind == "arm":
        c.arm(s, params)
    elif kind == "disarm":
        c.disarm(s, force=mode is Mode.HOLD)
    else:
        c.terminate("test")


def state(c: Commander) -> tuple[Any, ...]:
    return tuple(getattr(c, name) for name in FIELDS)


def fly(seed: int) -> int:
    """Fly a random sequence with and without the shortcut, and compare both in every step. Return the number of calm steps."""
    rng = random.Random(seed)
    params, calm_steps = random_params(rng), 0
    pair = Commander("uav1"), WithoutShortcut("uav1")
    inputs = CommanderInputs(aligned=True, xy_valid=True, z_valid=True, yaw_valid=True, offboard_age=0.02)
    until: dict[str, int] = {}
    for step in range(STEPS):
        now = 10.0 + step * PERIOD_S
        air = {
            "landed": step < 10,
            "flying": step > 12,
            "battery": 0.9,
            "offboard_age": 0.02,
            "tilt_rad": 0.1,
        }
        calm = {"xy_valid": True, "z_valid": True, "yaw_valid": True, "manual": NOTHING_RECEIVED, "fence": ""}
        calm |= {"gcs_age": 0.1, "global_ok": True, "home_ok": True, "mission_ok": False}
        for name in [name for name, last in until.items() if step <= last]:
            calm[name] = getattr(inputs, name)
            air.pop(name, None)
        if rng.random() < 0.05:
            name = rng.choice(list(DISTURBED))
            air[name], until[name] = rng.choice(DISTURBED[name]), step + rng.randrange(1, 30)
        inputs = dataclasses.replace(inputs, **{**calm, **air, "now": now})
        asked: list[tuple[str, Mode]] = []
        if step == 2:
            asked = [("mode", rng.choice((Mode.OFFBOARD, Mode.HOLD, Mode.TAKEOFF))), ("arm", Mode.HOLD)]
        elif rng.random() < 0.01:
            asked = [(rng.choice(("mode", "mode", "mode", "arm", "disarm", "end")), rng.choice(list(Mode)))]
        for c in pair:
            for each in asked:
                request(c, each, inputs, params)
        calm_steps += pair[0].armed and pair[0]._is_calm(inputs, params)
        for c in pair:
            c.update(inputs, params)
        assert state(pair[0]) == state(pair[1]), f"seed {seed}, step {step}"
    return calm_steps


def test_a_commander_with_the_shortcut_is_equal_to_one_without_it() -> None:
    calm = [fly(seed) for seed in range(SEQUENCES)]
    assert sum(steps > 30 for steps in calm) > SEQUENCES / 5


def test_a_calm_step_is_found() -> None:
    params = dataclasses.replace(
        random_params(random.Random(1)), nav_dll_act=0, fd_fail_rad=1.05, bat_low_thr=0.41, stick_speed=0.3
    )
    s = CommanderInputs(
        aligned=True,
        xy_valid=True,
        z_valid=True,
        yaw_valid=True,
        landed=False,
        flying=True,
        offboard_age=0.02,
        manual=NOTHING_RECEIVED,
    )
    c = Commander("uav1", mode=Mode.OFFBOARD, armed=True, armed_since=0.0, took_off=True)
    assert c._is_calm(s, params)
    for name in ("bat_low_thr", "bat_crit_thr", "bat_emergen_thr"):
        low = {"bat_low_thr": 0.1, "bat_crit_thr": 0.1, "bat_emergen_thr": 0.1, name: 1.0}
        assert not c._is_calm(s, dataclasses.replace(params, **low))
    for name, values in DISTURBED.items():
        if name in ("flying", "offboard_needs_position", "gcs_age", "global_ok", "home_ok", "mission_ok"):
            continue  # no rule reads them in OFFBOARD with position, without a data link failsafe
        for value in values:
            if name == "tilt_rad" and value <= params.fd_fail_rad:
                continue
            if name == "offboard_age" and value <= params.com_of_loss_t:
                continue
            assert not c._is_calm(dataclasses.replace(s, **{name: value}), params), (name, value)
