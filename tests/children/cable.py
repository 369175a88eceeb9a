"""A simulated serial cable between two pseudo-terminals, given by their file descriptors.

Bytes that an end does not read in time are lost, as on a real line; no end can block the other.
"""

import os
import select
import sys

MOST_BYTES = 1 << 15
ends = int(sys.argv[1]), int(sys.argv[2])
other = {ends[0]: ends[1], ends[1]: ends[0]}
waiting = dict.fromkeys(ends, b"")  # for each end, what it has still to hear
for fd in ends:
    os.set_blocking(fd, False)
while True:
    readable, writable, _ = select.select(ends, [fd for fd in ends if waiting[fd]], [])
    for fd in readable:
        waiting[other[fd]] = (waiting[other[fd]] + os.read(fd, 65536))[-MOST_BYTES:]
    for fd in writable:
        try:
            waiting[fd] = waiting[fd][os.write(fd, waiting[fd]) :]
        except BlockingIOError:
            continue
