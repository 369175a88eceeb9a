"""Records of flights (`flight.mcap`) made of synthetic data, for tests."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from arena.recorder.channels import RawChannels, Recorded
from arena.recorder.mcap_file import FLUSHES_PER_CHUNK, McapFile
from arena.wire.flight_record import METADATA, SIMULATION_CLOCK, RecordedVehicle, pack_metadata

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""First bytes of the data of each chunk."""
UAV1 = RecordedVehicle(name="uav1", id=1, body="body1", simulated=True, autopilot="builtin", profile="quad")
UAV2 = RecordedVehicle(name="uav2", id=2, body="body2", simulated=False, autopilot="px4", profile="quad")


class RecordFile:
    """Record under construction. Log to `channels`, then call `close`.

    path: flight.mcap.  vehicles: vehicles of the arena.  clock: clock of the record.
    max_waiting_bytes: as in `McapFile`.
    """

    def __init__(
        self,
        path: Path,
        vehicles: Sequence[RecordedVehicle] = (UAV1, UAV2),
        clock: str = SIMULATION_CLOCK,
        max_waiting_bytes: int = 1 << 24,
    ) -> None:
        metadata = pack_metadata(
            name="lab",
            clock=clock,
            start_s=0.5,
            start_unix_s=1.7e9,
            size_m=(8.0, 6.0, 3.0),
            vehicles=vehicles,
        )
        self.file = McapFile(path, METADATA, metadata, max_waiting_bytes=max_waiting_bytes)
        simulated = [v.name for v in vehicles if v.simulated]
        recorded = [
            Recorded(
                name=v.name, id=v.id, body=v.body, index=simulated.index(v.name) if v.simulated else None
            )
            for v in vehicles
        ]
        self.channels = RawChannels(recorded, self.file.channel)

    def end_chunk(self) -> None:
        """End the chunk of the file."""
        for _ in range(FLUSHES_PER_CHUNK):
            self.file.flush()

    def close(self) -> None:
        """Complete the file."""
        assert self.file.close()


def damage_second_chunk(path: Path, lost_bytes: int = 0) -> None:
    """Change one byte of the second chunk of a record.

    lost_bytes: bytes that are missing at the end of the file, as after a kill of the recorder.
    """
    data = bytearray(path.read_bytes())
    second = data.index(ZSTD_MAGIC, data.index(ZSTD_MAGIC) + 1)
    data[second + 50] ^= 0xFF
    path.write_bytes(data[: len(data) - lost_bytes])
