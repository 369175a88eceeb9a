"""Seeds of the flights with random faults that the tests fly."""

from __future__ import annotations

DAILY = (1023, 1700, 5584, 6615, 8535, 9153, 14570, 19767)
"""Flights of `make test`: each kind of fault on each kind of process, a link that never returns, and each kind of end.

Almost all of these faults come while the vehicles are in the air.
"""
_LONGER = (
    1003,
    1004,
    1005,
    1009,
    1010,
    1012,
    1017,
    1018,
    1039,
    1066,
    1090,
    1096,
    1122,
    1135,
    1146,
    1156,
    1171,
    1172,
)
NIGHTLY = (*range(1, 41), *_LONGER)
"""Further flights of `make nightly`: one fault to five."""
