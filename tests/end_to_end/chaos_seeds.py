"""Seeds of the flights with random faults that the tests fly."""

from __future__ import annotations

DAILY = (324533, 141870, 5671, 153122, 59937, 278780, 46452)
"""Flights of `make test`: each kind of fault on each kind of process, a link that never returns, and each kind of end.

Each kind comes at least once while a vehicle is in the air. The longest flights are first.
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
    1023,
    1700,
    5584,
    6615,
    8535,
    9153,
    14570,
    19767,
)
NIGHTLY = (*range(1, 41), *_LONGER)
"""Further flights of `make nightly`: one fault to five."""
