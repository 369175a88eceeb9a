"""Ends of the flights of one vehicle: touchdown, landing reported by the land detector, disarming. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from arena.flight_log.flight import Flight
from arena.report.link_record import StatusText

_ON_FLOOR_M = 0.03
_ARMING = ("Armed", "Disarmed")
"""First words of the STATUSTEXTs with which PX4 and the built-in autopilot report arming and disarming."""


@dataclass(frozen=True, kw_only=True)
class Disarming:
    """Last disarming of a vehicle. at_s: its time [s], on the axis of the given times.

    in_log: True if a row of the log is disarmed; False if only a text or an event reports the disarming, because the log has
        ended before the next row.
    """

    at_s: float
    in_log: bool


def touchdown_row(flight: Flight, first: int, last: int) -> int:
    """Return the row of the touchdown: from this row on the height is that of the landing, within 3 cm.

    first, last: rows of a flight, see `flown_times`. Returns `last` if the vehicle did not land.
    """
    up = -flight.pos[first : last + 1, 2]
    if not flight.landed[last] or not np.isfinite(up[-1]):
        return last
    above = np.flatnonzero(up - up[-1] > _ON_FLOOR_M)
    return min(last, first + int(above[-1]) + 1) if above.size else last


def disarming(
    flight: Flight, t: np.ndarray, texts: Sequence[StatusText], events_s: Sequence[float] = ()
) -> Disarming | None:
    """Return the last disarming; None if the vehicle was never armed or is armed at the end.

    t: times of the rows [s] (n,).  texts: the autopilot's STATUSTEXTs.  events_s: times at which the router reported the disarming [s].
    """
    armed = np.flatnonzero(flight.armed)
    if not armed.size:
        return None
    if not flight.armed[-1]:
        return Disarming(at_s=float(t[armed[-1] + 1]), in_log=True)
    off = np.flatnonzero(~flight.armed)
    armed_s = float(t[off[-1] + 1]) if off.size else float(t[0])
    newest = [x for x in texts if x.at_s > armed_s and x.text.startswith(_ARMING)][-1:]
    if newest and newest[0].text.startswith("Disarmed"):
        return Disarming(at_s=newest[0].at_s, in_log=False)
    later = [at for at in events_s if at > float(t[-1])]
    return Disarming(at_s=later[-1], in_log=False) if later else None
