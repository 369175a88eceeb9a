"""Writes a record until it is killed, and prints how many datagrams are on the disk: record_writer.py FOLDER."""

import sys
import time
from pathlib import Path

from record_files import RecordFile

record = RecordFile(Path(sys.argv[1]) / "flight.mcap")
count = 0
while True:
    for _ in range(100):
        record.channels.on_datagrams([("uav1", count % 2 == 1, count.to_bytes(4, "big"), 0.001 * count)])
        count += 1
    record.file.flush()
    while record.file.busy:
        time.sleep(0.001)
    print(count, flush=True)
