"""Fault injection for the emulated cameras. Pure.

A fault is a JSON object, see `arena.fault_injection`.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from arena.fault_injection import Fault, flag, number, plain, vector, word, words
from arena.mocap.emulator.core import EmulatedCameras

_MAX_OFFSET_M, _MAX_YAW_DEG, _MAX_DELAY_MS = 1e3, 360.0, 10_000.0


def apply_fault(cameras: EmulatedCameras, fault: Fault) -> str:
    """Apply one fault to the emulated cameras, and return a description for the event log.

    Raises InputError if the fault cannot be applied.
    """
    kinds: dict[str, Callable[[EmulatedCameras, Fault], str]] = {
        "dropout": _dropout,
        "freeze": _freeze,
        "jump": _jump,
        "swap": _swap,
        "delay": _delay,
    }
    return kinds[word(fault, "do", kinds)](cameras, fault)


def _dropout(cameras: EmulatedCameras, fault: Fault) -> str:
    body, on = word(fault, "body", cameras.bodies), flag(fault, "on")
    cameras.set_occluded(body, on)
    return f"{body} is {'not tracked' if on else 'tracked again'}"


def _freeze(cameras: EmulatedCameras, fault: Fault) -> str:
    body, on = word(fault, "body", cameras.bodies), flag(fault, "on")
    cameras.set_frozen(body, on)
    return f"the pose of {body} {'is frozen' if on else 'is no longer frozen'}"


def _jump(cameras: EmulatedCameras, fault: Fault) -> str:
    body, by_n = word(fault, "body", cameras.bodies), vector(fault, "by_m", _MAX_OFFSET_M)
    yaw_deg = number(fault, "yaw_deg", -_MAX_YAW_DEG, _MAX_YAW_DEG) if "yaw_deg" in fault else 0.0
    cameras.set_offset(body, by_n, math.radians(yaw_deg))
    if not (any(by_n) or yaw_deg):
        return f"the pose of {body} is no longer shifted"
    return f"the pose of {body} is shifted by {plain(by_n)} m" + (f" and {yaw_deg:g} deg" if yaw_deg else "")


def _swap(cameras: EmulatedCameras, fault: Fault) -> str:
    a, b = words(fault, "bodies", cameras.bodies, 2)
    on = flag(fault, "on")
    cameras.set_swapped(a, b, on)
    return f"{a} and {b} are {'swapped' if on else 'no longer swapped'}"


def _delay(cameras: EmulatedCameras, fault: Fault) -> str:
    ms = number(fault, "ms", 0.0, _MAX_DELAY_MS)
    cameras.delay_s = 1e-3 * ms
    return f"frames are delayed by {ms:g} ms" if ms else "frames are no longer delayed"
