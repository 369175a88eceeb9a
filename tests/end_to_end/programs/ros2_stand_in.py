"""Stand-in for the command `ros2`: a MAVROS that connects to a vehicle, and a bag recorder. It parses its arguments strictly.

`ros2 launch mavros px4.launch ...` prints MAVROS's line when a heartbeat of `tgt_system` arrives over `fcu_url`.
`ros2 bag record -o FOLDER -a` creates the folder, and writes metadata.yaml at SIGTERM, as rosbag2 does.
"""

import argparse
import os
import re
import signal
import socket
import sys
from pathlib import Path

from pymavlink.dialects.v20 import common as mavlink

_URL = re.compile(r"udp://([\d.]+):(\d+)@([\d.]+):(\d+)/")


def mavros(package: str, launch: str, *given: str) -> None:
    assert (package, launch) == ("mavros", "px4.launch")
    arguments = dict(each.split(":=", 1) for each in given)
    assert arguments.keys() == {"fcu_url", "gcs_url", "tgt_system", "namespace"}, arguments
    match = _URL.fullmatch(arguments["fcu_url"])
    assert match is not None, arguments["fcu_url"]
    host, port, remote, remote_port = match.groups()
    target = int(arguments["tgt_system"])
    link = mavlink.MAVLink(None, srcSystem=target, srcComponent=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER)
    beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3).pack(link)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind((host, int(port)))
        sock.settimeout(1.0)
        known = False
        while True:
            sock.sendto(beat, (remote, int(remote_port)))
            try:
                messages = link.parse_buffer(sock.recv(65535)) or []
            except TimeoutError:
                continue
            for m in messages:
                is_beat = m.get_type() == "HEARTBEAT" and (m.get_srcSystem(), m.get_srcComponent()) == (
                    target,
                    1,
                )
                if is_beat and not known:
                    known = True
                    name = f"{arguments['namespace'].replace('/', '.')}.mavros"
                    print(
                        f"[mavros_node-1] [INFO] [{name}]: CON: Got HEARTBEAT, connected. FCU: PX4 Autopilot",
                        flush=True,
                    )


def record(*given: str) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("-o", "--output", required=True)
    parser.add_argument("-s", "--storage", choices=("mcap", "sqlite3"))
    parser.add_argument("-a", "--all", action="store_true")
    parser.add_argument("-e", "--regex")
    options = parser.parse_args(given)
    assert options.all or options.regex
    Path(options.output).mkdir()
    print(f"[INFO] [rosbag2_recorder]: Recording... (domain {os.environ['ROS_DOMAIN_ID']})", flush=True)
    signal.sigwait({signal.SIGTERM, signal.SIGINT})
    Path(options.output, "metadata.yaml").write_text("rosbag2_bagfile_information:\n")


signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT} if sys.argv[1] == "bag" else set())
match sys.argv[1:]:
    case ["launch", *rest]:
        mavros(*rest)
    case ["bag", "record", *rest]:
        record(*rest)
    case other:
        sys.exit(f"unknown command: {other}")
