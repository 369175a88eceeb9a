"""Flights made from formulas, for the tests of films."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from arena.flight_log.columns import NED, WXYZ
from arena.flight_log.flight import Flight
from arena.geometry import quat_from_euler

START_S = 100.0


def circle_flight(
    name: str = "uav1", *, seconds: float = 12.0, phase: float = 0.0, t0: float = START_S
) -> Flight:
    """Return a flight on a circle of 1 m at a height of 1 m, with yaw along the circle. Armed from 2 s to 2 s before the end."""
    t = np.arange(0.0, seconds + 1e-9, 1 / 30)
    angle = phase + 0.5 * t
    p_n = np.stack([np.cos(angle), np.sin(angle), np.full(t.size, -1.0)], axis=1)
    rpy = np.stack([np.full(t.size, 0.1), np.full(t.size, -0.2), angle], axis=1)
    numbers = {f"truth.pos.{part}": p_n[:, k] for k, part in enumerate(NED)}
    numbers |= {f"truth.att_q.{part}": quat_from_euler(rpy)[:, k] for k, part in enumerate(WXYZ)}
    numbers |= {f"pos_ref.{part}": p_n[:, k] + 0.5 for k, part in enumerate(NED)}
    armed = (t >= 2.0) & (t <= seconds - 2.0)
    return Flight(
        name=name,
        t=t,
        t0=t0,
        numbers={"time.seconds": t0 + t, **numbers, "info.is_armed": armed.astype(float)},
        mode=["OFFBOARD" if a else "AUTO.LOITER" for a in armed],
        armed=armed,
        landed=~armed,
    )


def write_csv(flight: Flight, folder: Path) -> Path:
    """Write a flight as `csv/<name>.csv` in a folder, and return the path of the file."""
    values_of = {name: values for name, values in flight.numbers.items() if not name.startswith("info.")}
    names = [*values_of, "info.flight_mode", "info.is_armed", "info.is_landed"]
    columns = [[f"{x:.6f}" for x in values] for values in values_of.values()]
    columns += [list(flight.mode), [str(a) for a in flight.armed], [str(a) for a in flight.landed]]
    lines = [",".join(names), *(",".join(row) for row in zip(*columns, strict=True))]
    (folder / "csv").mkdir(exist_ok=True)
    file = folder / "csv" / f"{flight.name}.csv"
    file.write_text("\n".join(lines) + "\n")
    return file
