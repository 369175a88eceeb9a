"""Makes a `Flight` (the log of one vehicle) from arrays of measured quantities, and computes further columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from arena.flight_log.columns import FURTHER, THESIS, TRUTH, Group
from arena.flight_log.flight import Flight
from arena.geometry import Array, euler_from_quat, quat_conj, quat_log, quat_multiply, quat_rotate

_GROUPS: Mapping[str, Group] = {group.name: group for group in THESIS + FURTHER + TRUTH}


@dataclass(frozen=True, kw_only=True)
class States:
    """States of an autopilot (mode, armed, landed, battery) in each of the n rows of a log.

    mode: names of the flight modes (n,), "" if unknown.
    armed, landed: 1 or 0 (n,), NaN if unknown.  battery: remaining charge [%] (n,), NaN if unknown.
    """

    mode: Sequence[str]
    armed: Array
    landed: Array
    battery: Array


def make_flight(name: str, stamps: Array, groups: Mapping[str, Array], states: States) -> Flight:
    """Return the log of one vehicle, made from arrays of its measured quantities.

    stamps: values of the column `time.seconds` [s] (n,).
    groups: name of a quantity of `arena.flight_log.columns` -> its values (n, k), or (n,) for one component; NaN where unknown.
        Quantities that are missing get no columns, except those that are computed from others.
    """
    numbers: dict[str, Array] = {"time.seconds": stamps}
    for group, values in {**groups, **_derived(groups)}.items():
        cells = values.reshape(stamps.size, -1)
        numbers.update(zip(_GROUPS[group].columns, cells.T, strict=True))
    numbers |= {
        "info.is_armed": states.armed,
        "info.is_landed": states.landed,
        "info.battery": states.battery,
    }
    return Flight(
        name=name,
        t=stamps - stamps[0],
        t0=float(stamps[0]),
        numbers=numbers,
        mode=states.mode,
        armed=states.armed == 1.0,
        landed=states.landed == 1.0,
    )


def _derived(groups: Mapping[str, Array]) -> dict[str, Array]:
    """Return the quantities that are computed from measured ones: Euler angles, body velocity, estimate errors."""
    found: dict[str, Array] = {}
    for attitude, angles in (
        ("ekf.att_q", "ekf.att_euler"),
        ("mocap.att_q", "mocap.att_euler"),
        ("truth.att_q", "truth.att_euler"),
        ("att_q_ref", "att_euler_ref"),
    ):
        if attitude in groups:
            found[angles] = euler_from_quat(groups[attitude])
    if "ekf.vel" in groups and "ekf.att_q" in groups:
        found["ekf.vel_body"] = quat_rotate(quat_conj(groups["ekf.att_q"]), groups["ekf.vel"])
    for quantity in ("pos", "vel"):
        if f"truth.{quantity}" in groups and f"ekf.{quantity}" in groups:
            found[f"err.{quantity}"] = groups[f"ekf.{quantity}"] - groups[f"truth.{quantity}"]
    if "truth.att_q" in groups and "ekf.att_q" in groups:
        turned = quat_multiply(quat_conj(groups["truth.att_q"]), groups["ekf.att_q"])
        found["err.att_euler"] = quat_log(turned)
    return found
