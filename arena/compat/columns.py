"""Data of a vehicle for programs of the ISR Flying Arena thesis: vectors are columns (n, 1).

A value stays the last one that arrived, however old it is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from arena.compat.stale_reads import StaleReads
from arena.errors import StaleDataError


class Columns:
    """Read access to one data group of `arena.UAV`, such as `uav.ekf`, with vectors as columns (n, 1).

    A vector (n,) is a column (n, 1), and an array (n, 3) is (n, 3, 1). A value is None before its first arrival. It never raises
    StaleDataError, but a value of `fresh` that is too old is stored in `reads`.
    group: the group, whose values never get too old (`UAV.last_values`)
    fresh: the same group with an age limit; None: its values are not used for control
    reads: the values that were too old, and the name of the group in it
    own: values and groups of the thesis that replace those of the group, by name; a function computes its value at each access
    """

    def __init__(
        self,
        group: object,
        *,
        fresh: object = None,
        reads: tuple[StaleReads, str] | None = None,
        **own: Any,
    ) -> None:
        self._group, self._fresh, self._reads, self._own = group, fresh, reads, own

    def __getattr__(self, name: str) -> Any:
        own = self._own.get(name)
        if own is not None and not callable(own):
            return own
        try:
            return column(own() if own is not None else self._value(name))
        except StaleDataError:
            return None

    def _value(self, name: str) -> Any:
        """Return the last received value of a quantity, however old it is. Record in `reads` whether it was too old.

        Raises StaleDataError if no value has arrived.
        """
        if self._reads is None:
            return getattr(self._group, name)
        (reads, group), why = self._reads, ""
        try:
            value = getattr(self._fresh, name)
        except StaleDataError as error:
            value, why = getattr(self._group, name), str(error)
        reads.note(f"{group}.{name}", why)
        return value


def column(value: Any) -> Any:
    """Return an array (n,) as (n, 1), an array (n, 3) as (n, 3, 1), and any other value unchanged."""
    return value[..., np.newaxis] if isinstance(value, np.ndarray) else value
