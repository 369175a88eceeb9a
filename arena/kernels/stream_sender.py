"""Packs the periodic messages (streams) of built-in autopilots that are due in a step. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from arena.kernels.arrays import flags, floats

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.kernels.arrays import Integers
    from arena.kernels.payload_writer import PayloadWriter
    from arena.kernels.stream_schedule import StreamSchedule
    from arena.kernels.telemetry_packing import TelemetryPacking

    Mask = NDArray[np.bool_]


class StreamSender:
    """Packer of the periodic messages (S kinds) of V vehicles, which have K MAVLink links each.

    schedule: of all links; link k of vehicle i has the row i * K + k
    packing: packs most of the messages
    links: names of the links of each vehicle (K,)
    system_ids: MAVLink system ids of the vehicles (V,)
    sequence: sequence number of the next frame of each link (V * K,)
    writers: of `packing`, one for each message that it packs; None for a message that is built in Python (S,)
    rare: True for the messages that are placed before the others in a datagram (S,)
    needs_position: True for the messages that are sent only while the horizontal position is valid (S,)
    silent: input: True while a vehicle has no content for a message (V, S)
    wake_s: input: time from which Python must send for a vehicle, because it has more to send than streams [s] (V,)
    """

    def __init__(
        self,
        schedule: StreamSchedule,
        packing: TelemetryPacking,
        links: list[str],
        system_ids: Integers,
        sequence: Integers,
        writers: list[PayloadWriter | None],
        rare: Mask,
        needs_position: Mask,
        silent: Mask,
    ) -> None:
        self.schedule, self.packing, self.links = schedule, packing, links
        self.system_ids, self.sequence = system_ids, sequence
        self.writers, self.rare = writers, flags(rare)
        self.needs_position, self.silent = flags(needs_position), flags(silent)
        self.wake_s = floats(len(system_ids))

    def has_output(self, now: float) -> bool:
        """Return whether any vehicle has a message to send at `now` [s]."""
        first = float("inf")
        for i in range(len(self.wake_s)):
            first = min(first, self.wake_s[i])
        return first <= now or self.schedule.is_any_due(0, len(self.schedule.next_s), now)

    def step(self, now: float) -> list[tuple[int, str, bytes]]:
        """Return (vehicle, link, datagram) for the periodic messages that are due at `now` [s].

        A vehicle for which Python must send is (vehicle, "", b""), and its streams stay due.
        """
        found = []
        count = len(self.links)
        for i in range(len(self.wake_s)):
            wakes = now >= self.wake_s[i]
            if not (wakes or self.schedule.is_any_due(i * count, (i + 1) * count, now)):
                continue
            if wakes or self._has_unpacked(i, now):
                found.append((i, "", b""))
                continue
            for k in range(count):
                if self.schedule.is_due(i * count + k, now):
                    datagram = self._datagram(i, i * count + k, now)
                    if datagram:
                        found.append((i, self.links[k], datagram))
        return found

    def has_content(self, i: int, column: int) -> bool:
        """Return whether vehicle i has valid data for a message, so that the message can be sent.

        Messages that are built in Python may still have none.
        """
        if self.silent[i, column]:
            return False
        return not self.needs_position[column] or bool(self.packing.xy_valid[i])

    def _has_unpacked(self, i: int, now: float) -> bool:
        """Return whether a due message of vehicle i must be built by Python code, because this kernel cannot build it."""
        count, schedule = len(self.links), self.schedule
        for row in range(i * count, (i + 1) * count):
            if not schedule.is_due(row, now):
                continue
            place, column = 0, schedule.due_column(row, 0, now)
            while column >= 0:
                if self.writers[column] is None and not self.silent[i, column]:
                    return True
                place += 1
                column = schedule.due_column(row, place, now)
        return False

    def _datagram(self, i: int, row: int, now: float) -> bytes:
        """Return a datagram with all messages of vehicle i that are due on a link; b"" if there are none.

        row: of the link in the schedule
        """
        due: list[PayloadWriter] = []
        rare_count, needs = 0, 0
        column = self.schedule.take_next(row, now)
        while column >= 0:
            writer = self.writers[column]
            if writer is not None and self.has_content(i, column):
                needs |= writer.needs
                if self.rare[column]:
                    due.insert(rare_count, writer)
                    rare_count += 1
                else:
                    due.append(writer)
            column = self.schedule.take_next(row, now)
        if not due:
            return b""
        packing, seq = self.packing, self.sequence[row]
        packing.begin(i, needs)
        for writer in due:
            seq = packing.append(i, writer, row, seq, self.system_ids[i], 1)
        self.sequence[row] = seq
        return packing.datagram()
