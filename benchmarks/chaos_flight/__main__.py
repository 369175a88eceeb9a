"""One flight of the campaign: python -m benchmarks.chaos_flight SEED FOLDER. The record is written to FOLDER/record.json."""

from __future__ import annotations

import os
import signal
import sys
from pathlib import Path

from benchmarks.chaos_flight.disk import SmallDisk
from benchmarks.chaos_flight.faults import DISK_FAULTS, draw
from benchmarks.chaos_flight.flight import ChaosFlight
from tests.end_to_end.flight import Hangar, end_with_us


def main(seed: int, folder: Path) -> None:
    """Fly one seed. folder: for the run folder and the record."""
    end_with_us()
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(128 + number))
    script = draw(seed)
    kinds = {fault.what for fault in script.faults} & DISK_FAULTS.keys()
    disk = SmallDisk.mount(folder / "runs", may_hang="hung disk" in kinds) if kinds else None
    net = f"127.{71 + seed // 60000}.{seed // 240 % 250}.{seed % 240 + 1}"
    room = f"127.{101 + seed // 60000}.{seed // 240 % 250}.{seed % 240 + 1}"
    try:
        record = ChaosFlight(script, Hangar(folder, net, cold=True), room, disk).fly()
    finally:
        if disk is not None:
            disk.close(folder / "runs of the small disk")
    partly = folder / "record.new"
    partly.write_text(record.to_json())
    partly.replace(folder / "record.json")


if __name__ == "__main__":
    os.chdir(Path(__file__).parents[2])
    main(int(sys.argv[1]), Path(sys.argv[2]))
