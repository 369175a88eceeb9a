"""Memory for the periodic ULog records of all vehicles during one second; overwritten every second.

All vehicles record the same topics at the same steps, so the records of a topic have the same place in the row of each vehicle.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.autopilot.ulog.message_formats import FORMATS
from arena.autopilot.ulog.topics import PERIODIC, STATE
from arena.wire.ulog_messages import record_type, set_record_head

Bytes = NDArray[np.uint8]
Records = NDArray[np.void]
_CYCLE_S = 1.0


@dataclass(slots=True)
class Step:
    """ULog records to fill in one sensor period, and the functions that compute their values.

    The steps repeat every second.

    prepares: functions that compute the quantities
    copies: pairs of arrays: place in the records, and the quantity
    end: number of bytes in a row after this step
    """

    prepares: list[Callable[[], None]] = field(default_factory=list)
    copies: list[tuple[NDArray[Any], NDArray[Any]]] = field(default_factory=list)
    end: int = 0


class Layout:
    """Memory for the periodic ULog records of V vehicles during one second; overwritten every second.

    rows: the bytes of the records (V, B)
    steps: work of each step of the cycle
    state: topic of `STATE` -> newest records of all vehicles, written by `FlightState` (V,)
    """

    def __init__(
        self,
        vehicles: int,
        period_s: float,
        quantities: Mapping[str, NDArray[Any]],
        groups: Mapping[str, Callable[[], None]],
    ) -> None:
        """Reserve the memory, and compute which ULog records are filled in each sensor period.

        period_s: sensor period [s]
        quantities: quantity -> its array over all vehicles
        groups: name of a group -> function that computes its quantities
        """
        self._groups = groups
        types = {topic: record_type(FORMATS[topic]) for topic in PERIODIC}
        self.state = {topic: np.zeros(vehicles, types[topic]) for topic in STATE}
        for number, topic in enumerate(PERIODIC):
            if topic in STATE:
                set_record_head(self.state[topic], number)
        count = max(1, round(_CYCLE_S / period_s))
        due = [[topic for topic in PERIODIC if _is_due(topic, k, period_s)] for k in range(count)]
        size = sum(types[topic].itemsize for topics in due for topic in topics)
        self.rows: Bytes = np.zeros((vehicles, size), np.uint8)
        self.steps: list[Step] = []
        at = 0
        for topics in due:
            step = Step()
            for topic in topics:
                end = at + types[topic].itemsize
                self._add(step, topic, self.rows[:, at:end], types[topic], quantities)
                at = end
            step.end = at
            self.steps.append(step)

    def _add(
        self,
        step: Step,
        topic: str,
        place: Bytes,
        kind: np.dtype[np.void],
        quantities: Mapping[str, NDArray[Any]],
    ) -> None:
        """Add the record of a ULog topic to the work of one step.

        place: bytes of the record in the row of each vehicle
        """
        group = self._groups.get(PERIODIC[topic].group or ("state" if topic in STATE else ""))
        if group is not None and group not in step.prepares:
            step.prepares.append(group)
        if topic in STATE:
            step.copies.append((place, self.state[topic].view(np.uint8).reshape(place.shape)))
            return
        records = place.view(kind)[:, 0]
        set_record_head(records, list(PERIODIC).index(topic))
        for name, content in PERIODIC[topic].fields.items():
            to = _field(records, name)
            if isinstance(content, str):
                step.copies.append((to, quantities[content]))
            else:
                to[...] = content


def _is_due(topic: str, k: int, period_s: float) -> bool:
    """Return whether a topic is recorded in the sensor period with number k of each second.

    The slow topics begin at different steps, so that no step has much more work than the others.
    """
    wanted_s = PERIODIC[topic].period_s
    if wanted_s <= period_s:
        return True
    shifted = k + list(PERIODIC).index(topic)
    return math.floor(shifted * period_s / wanted_s + 1e-6) > math.floor(
        (shifted - 1) * period_s / wanted_s + 1e-6
    )


def _field(records: Records, name: str) -> NDArray[Any]:
    """Return a field (`xyz`), or an element of a field (`xyz[2]`), of the ULog records of all vehicles.

    name: such as `xyz` or `xyz[2]`
    """
    name, _, element = name.rstrip("]").partition("[")
    return records[name][:, int(element)] if element else records[name]
