"""The first commands of land-all and kill-all, sent before anything is printed or written and before the telemetry is read."""

import dataclasses
import json
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from emergency_fleet import target
from pymavlink.dialects.v20 import common as mavlink

from arena.emergency import land_all as command_line
from arena.emergency.first_commands import send_first_commands
from arena.emergency.run_record import DirectAddress
from arena.transport import ConnectionUrl
from arena.wire.mavlink_ids import EMERGENCY

HOST = "127.54.21.1"


@pytest.fixture
def ends():
    """Return the vehicle's end of the panic link and the router's tools port of vehicle 1."""
    one = target(1, HOST)
    sockets = []
    for address in (one.autopilot, one.tools):
        sockets.append(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        sockets[-1].bind(address)
        sockets[-1].settimeout(60.0)
    yield sockets
    for one in sockets:
        one.close()


def commands(end):
    """Return the commands of a heartbeat, a mode command and a land command, or of a heartbeat and a forced disarming."""
    parser, found = mavlink.MAVLink(None), []
    end.setblocking(False)
    while True:
        try:
            data, sender = end.recvfrom(2048)
        except BlockingIOError:
            return found
        assert sender[0] == HOST  # the hardware link drops datagrams from other addresses
        found += [m for m in parser.parse_buffer(data) or () if m.get_type() == "COMMAND_LONG"]


@pytest.mark.parametrize(("action", "expected"), [("land", [176, 21]), ("kill", [400])])
def test_first_commands_go_to_panic_link_and_router(ends, action, expected):
    nobody = dataclasses.replace(
        target(2, HOST), partner=("203.0.113.7", 1)
    )  # an address of another computer
    send_first_commands([nobody, target(1, HOST)], action)
    for end in ends:
        assert [m.command for m in commands(end)] == expected


def test_vehicle_that_signs_gets_commands_of_one_sender(ends):
    direct = dataclasses.replace(
        DirectAddress.of(ConnectionUrl(kind="udp", host=HOST, port=1)), key_file="uav1.key"
    )
    send_first_commands([dataclasses.replace(target(1, HOST), direct=direct)], "land")
    assert {m.get_srcComponent() for m in commands(ends[0])} == {EMERGENCY.signed}


def test_first_command_is_sent_before_anything_is_printed(ends, monkeypatch, tmp_path):
    link = {"autopilot_host": HOST, "autopilot_port": 24014, "partner_host": HOST, "partner_port": 24015}
    vehicle = {"name": "uav1", "id": 1, "simulated": True, "panic": link, "router": link, "tools_port": 24016}
    (tmp_path / "plan.json").write_text(json.dumps({"vehicles": [vehicle], "slices": {}}))
    sent_before = []
    monkeypatch.setattr(command_line, "_say", lambda line: sent_before.append(len(commands(ends[0]))))
    assert command_line.land_all(run=tmp_path, timeout_s=0.1) == 1
    assert sent_before[0] == 2


def test_modules_that_check_the_landing_are_not_needed_for_the_first_command():
    code = "import sys, arena.emergency.land_all; print('arena.emergency.dispatch' in sys.modules, 'yaml' in sys.modules)"
    folder = Path(command_line.__file__).parents[2]
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=folder
    )
    assert done.stdout.split() == ["False", "False"]
