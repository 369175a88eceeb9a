"""A tool for tests of readiness: prints a line, makes a file or binds a port, when the file `go` exists.

Usage: tool.py GO KIND [argument]
"""

from __future__ import annotations

import signal
import socket
import sys
import time
from pathlib import Path

go, kind, *rest = sys.argv[1:]
print("starting", flush=True)
while not Path(go).exists():
    time.sleep(0.02)
kept = []
if kind == "log":
    print(rest[0], flush=True)
elif kind == "file":
    Path(rest[0]).touch()
elif kind in ("udp", "tcp"):
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM if kind == "udp" else socket.SOCK_STREAM)
    made.bind(("127.0.0.1", int(rest[0])))
    if kind == "tcp":
        made.listen()
    kept.append(made)
while True:
    signal.pause()
