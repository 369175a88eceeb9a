"""Stand-in for MicroXRCEAgent: binds its UDP port when the file GO exists. Usage: xrce_agent.py GO udp4 -p PORT"""

from __future__ import annotations

import signal
import socket
import sys
import time
from pathlib import Path

if sys.argv[2:4] != ["udp4", "-p"]:
    sys.exit(f"unexpected arguments: {sys.argv[2:]}")
while not Path(sys.argv[1]).exists():
    time.sleep(0.02)
agent = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
agent.bind(("127.0.0.1", int(sys.argv[4])))
while True:
    signal.pause()
