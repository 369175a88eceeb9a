"""Faults on purpose in the motion capture: one JSON object of `arena.fault_injection` -> a call of the emulator. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable

from arena.fault_injection import Fault, flag, number, plain, vector, word, words
from arena.mocap.emulator.core import Emulator

_FAR_M, _TURN_DEG, _LONGEST_MS = 1e3, 360.0, 10_000.0


def spoil(cameras: Emulator, fault: Fault) -> str:
    """Do it -> what it is, in a few words. Raises InputError for one that makes no sense."""
    kinds: dict[str, Callable[[Emulator, Fault], str]] = {
        "dropout": _dropout,
        "freeze": _freeze,
        "jump": _jump,
        "swap": _swap,
        "delay": _delay,
    }
    return kinds[word(fault, "do", kinds)](cameras, fault)


def _dropout(cameras: Emulator, fault: Fault) -> str:
    body, on = word(fault, "body", cameras.bodies), flag(fault, "on")
    cameras.occlude(body, on)
    return f"{body} is {'not tracked' if on else 'tracked again'}"


def _freeze(cameras: Emulator, fault: Fault) -> str:
    body, on = word(fault, "body", cameras.bodies), flag(fault, "on")
    cameras.freeze(body, on)
    return f"the pose of {body} {'is frozen' if on else 'moves again'}"


def _jump(cameras: Emulator, fault: Fault) -> str:
    body, by_n = word(fault, "body", cameras.bodies), vector(fault, "by_m", _FAR_M)
    yaw_deg = number(fault, "yaw_deg", -_TURN_DEG, _TURN_DEG) if "yaw_deg" in fault else 0.0
    cameras.jump(body, by_n, math.radians(yaw_deg))
    if not (any(by_n) or yaw_deg):
        return f"{body} is seen where it is"
    return f"{body} is seen {plain(by_n)} m" + (f" and {yaw_deg:g} deg" if yaw_deg else "") + " off"


def _swap(cameras: Emulator, fault: Fault) -> str:
    a, b = words(fault, "bodies", cameras.bodies, 2)
    on = flag(fault, "on")
    cameras.swap(a, b, on)
    return f"{a} and {b} are {'taken for each other' if on else 'told apart again'}"


def _delay(cameras: Emulator, fault: Fault) -> str:
    ms = number(fault, "ms", 0.0, _LONGEST_MS)
    cameras.delay_s = 1e-3 * ms
    return f"frames leave {ms:g} ms later" if ms else "frames leave in time"
