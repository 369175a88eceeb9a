"""Seeds of the flights with random faults that the tests fly."""

from __future__ import annotations

DAILY = (
    *(8, 1003, 1004, 1005, 1009, 1010, 1012, 1017, 1018, 1023),
    *(1039, 1066, 1090, 1096, 1122, 1135, 1146, 1156, 1171, 1172),
)
"""Flights whose faults were almost all carried out while the vehicles were in the air: 71 faults of every kind, and every end."""
NIGHTLY = range(1, 41)
"""Flights of `make nightly`: one fault to five."""
