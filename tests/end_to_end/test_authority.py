"""Authority over a flying vehicle, in whole arenas: no program undoes land-all, also not a restarted one."""

from __future__ import annotations

import os
import signal
import socket
import time

import pytest
from fake_autopilot import FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink
from served import Connection, Served, UdpPort

from arena.wire.mavlink_codec import Codec

from .flight import Flight, Hangar, eventually

pytestmark = pytest.mark.flight


def restart_program(flight: Flight) -> None:
    told = flight.cli("restart", "program.uav1", "--yes")
    assert told.returncode == 0, told.stderr


def test_restarted_program_flies_again_only_after_release(hangar: Hangar) -> None:  # review fault 9
    flight = hangar.fly({"uav1": "hovers"}, "--speed", "3", "--processes")
    flight.until_up(0.5)
    nothing = flight.cli("release", "uav1")
    assert nothing.returncode == 1
    assert (
        "uav1: no release is needed: programs are already allowed to command this vehicle (control: program)"
        in nothing.stderr
    )
    assert flight.cli("land-all", limit_s=90.0).returncode == 0
    flight.until_said("uav1: land-all has control: landing, until `arena release`", 10)
    flight.until_event("program.uav1", "EXITED", 30)  # it lost its vehicle

    restart_program(flight)
    flight.until_event("program.uav1", "EXITED", 60, times=2)
    assert "land-all has control: run `arena release`" in flight.log("program.uav1")
    assert flight.fact("uav1.armed") is False

    assert flight.cli("release", "uav1").returncode == 0
    eventually(lambda: flight.fact("uav1.blocked") == "", 10, "released", flight.said)
    restart_program(flight)
    flight.until_up(0.5)
    assert flight.cli("down", limit_s=90.0).returncode in (0, 1)
    flight.wait()
    flight.assert_nothing_left()


ARM, RELEASE = mavlink.MAV_CMD_COMPONENT_ARM_DISARM, "land-all has control: run `arena release`"


class ProgramPort:
    """Port of the program of vehicle 1, from which the test requests arming."""

    def __init__(self, flight: Flight) -> None:
        (vehicle,) = flight.json("plan.json")["vehicles"]
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((flight.address, vehicle["port"]))
        self._socket.settimeout(60.0)
        _, self._router = self._socket.recvfrom(65535)
        self._codec = Codec(1, 191)

    def arm(self) -> tuple[int, list[str]]:
        """Request arming. Return the MAV_RESULT and the texts that were sent before it."""
        command = mavlink.MAVLink_command_long_message(1, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0)
        self._socket.sendto(self._codec.pack(command), self._router)
        texts: list[str] = []
        end = time.monotonic() + 60.0
        while True:
            assert time.monotonic() < end, f"no acknowledgement, only {texts}"
            for message in self._codec.parse(self._socket.recv(65535)):
                if message.get_type() == "STATUSTEXT":
                    texts.append(message.text)
                if message.get_type() == "COMMAND_ACK" and message.command == ARM:
                    return message.result, texts

    def close(self) -> None:
        self._socket.close()


def armings(uav: FakeAutopilot) -> int:
    """Return how many commands to arm have reached the autopilot."""
    return sum(c.command == ARM and c.param1 == 1.0 for c in list(uav.commands))


def test_killed_router_and_link_still_refuse_arming_after_land_all(hangar: Hangar) -> None:
    here = (hangar.address, 14540)
    file = hangar.folder / "arena.yaml"
    file.write_text(f"""\
name: latched
address: {hangar.address}
preflight: {{params: false, battery: 0}}
vehicles:
  uav1: {{autopilot: hardware, profile: iris, radio: none, forward: false, url: "udpin:{here[0]}:{here[1]}"}}
""")
    telemetry = ("HEARTBEAT", "SYS_STATUS", "ATTITUDE", "LOCAL_POSITION_NED", "EXTENDED_SYS_STATE")
    uav = FakeAutopilot(uid2=bytes(range(1, 19)), telemetry=telemetry, period_s=0.05, land_s=0.2)
    with Served([Connection(autopilot=uav, port=UdpPort((hangar.address, 14999)), remote=here)]):
        flight = hangar.up(file, "--yes", "--no-report")

        def has_permit(times: int) -> bool:
            return sum("arm permit granted by" in e.get("event", "") for e in flight.events()) >= times

        eventually(lambda: has_permit(1), 60, "the first permit", flight.said)
        program = ProgramPort(flight)
        assert program.arm() == (mavlink.MAV_RESULT_ACCEPTED, []) and uav.armed
        assert flight.cli("land-all", limit_s=90.0).returncode == 0
        eventually(lambda: flight.fact("uav1.blocked_at_link"), 10, "the latch", flight.said)

        for name in ("router", "link.uav1"):
            os.kill(flight.pid(name), signal.SIGKILL)
        for name in ("router", "link.uav1"):
            flight.until_event(name, "READY", 60, times=2)
        assert flight.cli("arm-permit", "uav1").returncode == 0
        assert program.arm() == (mavlink.MAV_RESULT_DENIED, [RELEASE]) and not uav.armed
        for fact in ("uav1.blocked", "uav1.blocked_at_link"):  # told after the reply to the request
            eventually(lambda fact=fact: flight.fact(fact) == "land-all has control", 10, fact, flight.status)

        released = flight.cli("release", "uav1")
        assert released.returncode == 0, released.stderr
        before = armings(uav)
        # it is still in AUTO.LAND, so it disarms again at once
        assert program.arm()[0] == mavlink.MAV_RESULT_ACCEPTED and armings(uav) == before + 1
        program.close()
        assert flight.cli("land-all", limit_s=90.0).returncode == 0
        flight.signal(signal.SIGTERM)
        flight.wait()
