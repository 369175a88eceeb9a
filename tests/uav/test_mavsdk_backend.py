"""The MAVSDK backend sends what the program asks for, once, and nothing by itself."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from fake_autopilot import FakeAutopilot
from pymavlink.dialects.v20 import common as mavlink
from served import UdpPort, let_pass, until

from arena.errors import InputError, NotConfirmedError, NotInstalledError, RunError
from arena.uav.backend import Wire
from arena.uav.setpoints import Encoder, attitude
from arena.wire.mavlink_codec import Codec
from arena.wire.telemetry import Telemetry

from .conftest import free_address, make_uav

pytest.importorskip("mavsdk.plugins.mavlink_direct", reason="mavsdk is not installed")

from arena.uav import mavsdk_backend
from arena.uav.mavsdk_backend import MavsdkBackend
from arena.uav.mavsdk_setpoints import same_setpoint

POS, VEL, ACC = [1.25, -2.5, -1.75], [0.5, -0.25, 0.125], [0.1, 0.2, -0.3]
ENCODER = Encoder(1)
SETPOINTS = {
    "position": ENCODER.pos_yaw(POS, 2.9, 1.0),
    "velocity": ENCODER.vel_yaw(VEL, -3.1, 1.0),
    "position and velocity": ENCODER.pos_vel_yaw(POS, VEL, 0.7, 1.0),
    "with acceleration": ENCODER.pos_vel_yaw(POS, VEL, 0.7, 1.0, acc=ACC),
    "with yaw rate": ENCODER.pos_vel_yaw(POS, VEL, 0.7, 1.0, yaw_rate=0.4),
    "all": ENCODER.pos_vel_yaw(POS, VEL, 0.7, 1.0, acc=ACC, yaw_rate=0.4),
    "body velocity": ENCODER.vel_body_yaw_rate(VEL, -0.6, 1.0),
    "attitude": ENCODER.att_thrust(attitude(np.radians([10.0, -20.0, 35.0]), "euler"), 0.61, 1.0),
    "attitude upside down": ENCODER.att_thrust(
        attitude(np.radians([170.0, 20.0, -175.0]), "euler"), 0.4, 1.0
    ),
    "rates": ENCODER.ang_vel_thrust([0.5, -1.0, 2.0], 0.55, 1.0),
    "actuators": ENCODER.act(2, [0.1, -0.2, 0.3], 1.0),
}


class Sent:
    """A backend without sockets that has received a heartbeat, and the messages that it has sent."""

    def __init__(self, *, heartbeat: bool = True) -> None:
        self.codec, self.messages = Codec(1, 191), []
        self.telemetry = Telemetry(1)
        self.backend = MavsdkBackend(
            Wire(
                system_id=1,
                telemetry=self.telemetry,
                send=self.messages.append,
                send_payload=lambda msgid, payload: self.messages.extend(
                    self.codec.parse(self.codec.frame(msgid, payload))
                ),
            )
        )
        if heartbeat:
            self.receive(FakeAutopilot(telemetry=("HEARTBEAT",)).state(0.0))

    def receive(self, datagram: bytes) -> None:
        self.telemetry.on_datagram(datagram, 0.0)
        self.backend.receive(datagram)


@pytest.fixture
def sent():
    made = Sent()
    yield made
    made.backend.close()


@pytest.mark.parametrize("asked", SETPOINTS.values(), ids=SETPOINTS)
def test_setpoint_equals_that_of_pymavlink(sent, asked):
    sent.backend.send_setpoint(asked)
    (found,) = sent.messages
    assert found.get_type() == asked.get_type()
    ignored = {"time_boot_ms", "time_usec", "q"}
    for name in set(asked.get_fieldnames()) - ignored:
        assert getattr(found, name) == pytest.approx(getattr(asked, name), abs=2e-6), name
    if hasattr(asked, "q") and not asked.type_mask & mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE:
        assert abs(np.dot(found.q, asked.q)) == pytest.approx(1.0, abs=1e-6)


def test_backends_without_a_channel_of_their_own_are_refused():
    made = []
    try:
        with pytest.raises(InputError, match="at most 16 vehicles in one process"):
            made.extend(Sent(heartbeat=False) for _ in range(17))
        assert len(made) == 16
        made.pop().backend.close()
        made.append(Sent(heartbeat=False))
    finally:
        for one in made:
            one.backend.close()


@pytest.mark.parametrize("call", ["send_setpoint", "command"])
def test_call_after_the_end_raises_instead_of_ending_the_process(call):
    code = f"""
from uav.test_mavsdk_backend import SETPOINTS, NotConfirmedError, Sent
backend = Sent().backend
backend.close()
try:
    backend.{call}({"SETPOINTS['position']" if call == "send_setpoint" else 400})
except NotConfirmedError as error:
    print(error)
"""
    here = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run(
        [sys.executable, "-c", code], env=here, capture_output=True, text=True, timeout=60, check=False
    )
    assert (ended.returncode, ended.stdout.splitlines()[-1:]) == (
        0,
        ["the connection to the vehicle is closed"],
    )


def test_close_directly_after_an_acknowledgement_does_not_end_the_process():
    """A thread of MAVSDK reports the result at this moment. Without the mend, 4 of 5 processes ended within 100."""
    code = """
from uav.test_mavsdk_backend import ENCODER, FakeAutopilot, Sent
for _ in range(200):
    sent = Sent()
    sent.backend.command(400).send(ENCODER.command(400, (1.0,), 0))
    for reply in FakeAutopilot().receive(sent.codec.pack(sent.messages[0]), 0.0):
        sent.receive(reply)
    sent.backend.close()
print("closed")
"""
    here = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run(
        [sys.executable, "-c", code], env=here, capture_output=True, text=True, timeout=300, check=False
    )
    assert (ended.returncode, ended.stdout.splitlines()[-1:]) == (0, ["closed"]), ended.stderr


@pytest.mark.parametrize("name", ["Mavsdk", "add_any_connection", "subscribe_raw_bytes_to_be_sent"])
def test_backend_that_cannot_be_made_gives_its_channel_back(monkeypatch, name):
    def refuse(*_: object) -> None:
        raise RuntimeError("no connection")

    with monkeypatch.context() as patch:
        patch.setattr(
            mavsdk_backend.mavsdk if name == "Mavsdk" else mavsdk_backend.mavsdk.Mavsdk, name, refuse
        )
        for _ in range(mavsdk_backend._CHANNELS.LIMIT + 1):
            with pytest.raises(RuntimeError, match="no connection"):
                Sent(heartbeat=False)
    Sent(heartbeat=False).backend.close()


def test_refused_connection_raises_with_the_reason_of_mavsdk(monkeypatch):
    refused = mavsdk_backend.mavsdk.ConnectionResult.CONNECTIONS_EXHAUSTED
    with monkeypatch.context() as patch:
        patch.setattr(mavsdk_backend.mavsdk.Mavsdk, "add_any_connection", lambda *_: refused)
        with pytest.raises(RunError, match="cannot add a connection: CONNECTIONS_EXHAUSTED"):
            Sent(heartbeat=False)
    Sent(heartbeat=False).backend.close()


def test_errors_of_mavsdk_are_subscribed_once_per_process(monkeypatch):
    """A second subscription frees the function of the first one, which a thread of MAVSDK may call at this moment."""
    calls = []
    monkeypatch.setattr(mavsdk_backend.mavsdk, "log_subscribe", calls.append)
    mavsdk_backend._subscribe_to_errors.cache_clear()
    for one in [Sent(heartbeat=False) for _ in range(3)]:
        one.backend.close()
    assert len(calls) == 1


def test_repetitions_of_mavsdk_are_dropped(sent):
    sent.backend.send_setpoint(SETPOINTS["velocity"])
    until(lambda: sent.backend.dropped >= 5)
    assert len(sent.messages) == 1


def test_old_setpoint_is_not_sent_in_place_of_the_new_one(sent):
    for number in range(200):
        sent.backend.send_setpoint(ENCODER.vel_yaw([0.01 * number, 0, 0], 0.0, 1.0))
    assert [m.vx for m in sent.messages] == pytest.approx([0.01 * n for n in range(200)], abs=1e-6)


@pytest.mark.parametrize(("one", "two"), [("velocity", "with yaw rate"), ("with yaw rate", "position")])
def test_change_of_the_kind_of_setpoint_leaves_no_old_setpoint(sent, one, two):
    sent.backend.send_setpoint(SETPOINTS[one])
    sent.backend.send_setpoint(SETPOINTS[two])
    until(lambda: sent.backend.dropped >= 3)
    assert [m.type_mask for m in sent.messages] == [SETPOINTS[one].type_mask, SETPOINTS[two].type_mask]


@pytest.mark.parametrize("field", ["x", "vz", "afy", "yaw", "yaw_rate", "type_mask", "coordinate_frame"])
def test_changed_setpoint_is_not_the_same(field):
    other = ENCODER.pos_vel_yaw(POS, VEL, 0.7, 1.0, acc=ACC, yaw_rate=0.4)
    assert same_setpoint(SETPOINTS["all"], other)
    setattr(other, field, getattr(other, field) + 1)
    assert not same_setpoint(SETPOINTS["all"], other)


def test_setpoint_before_the_first_heartbeat_raises():
    silent = Sent(heartbeat=False)
    with pytest.raises(NotConfirmedError, match="has not received a heartbeat"):
        silent.backend.send_setpoint(SETPOINTS["position"])
    silent.backend.close()


def test_refusal_is_the_result_of_a_command(sent):
    command = sent.backend.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    command.send(ENCODER.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0,), 0))
    assert command.result() is None
    autopilot = FakeAutopilot(refuse={mavlink.MAV_CMD_COMPONENT_ARM_DISARM: (2, b"")})
    for message in sent.messages:
        for reply in autopilot.receive(sent.codec.pack(message), 0.0):
            sent.receive(reply)
    assert command.result() == mavlink.MAV_RESULT_DENIED


def test_missing_mavsdk_raises_with_the_command_that_installs_it(monkeypatch):
    host, port = free_address()
    monkeypatch.setitem(sys.modules, "mavsdk", None)
    monkeypatch.delitem(sys.modules, "arena.uav.mavsdk_backend")
    monkeypatch.delitem(sys.modules, "arena.uav.mavsdk_setpoints")
    with pytest.raises(NotInstalledError, match=r"pip install 'flying-arena\[sdk\]'"):
        make_uav((host, port), backend="mavsdk")


def test_closed_backend_sends_nothing(sent):
    sent.backend.send_setpoint(SETPOINTS["velocity"])
    sent.backend.close()
    dropped = sent.backend.dropped
    sent.backend.close()
    assert (len(sent.messages), sent.backend.dropped) == (1, dropped)


def test_program_that_hangs_sends_no_heartbeat_to_the_copilot(autopilot, address):
    copilot = UdpPort(("127.56.3.1", 0))
    with make_uav(address, backend="mavsdk", heartbeat=copilot.address) as uav:
        until(lambda: uav.info.is_connected and uav.ekf.age_s < 0.5)
        uav.set_vel_yaw([0, 0, -1], 0.0, 50)
        until(copilot.read)
        backend = uav._connection._backend
        until(lambda: backend.dropped >= 10)
        assert copilot.read() is None
    copilot.close()


def test_program_that_hangs_sends_neither_setpoints_nor_commands(autopilot, address):
    with make_uav(address, backend="mavsdk") as uav:
        until(lambda: uav.info.is_connected and uav.ekf.age_s < 0.5)
        uav.start_offboard_mission()
        uav.set_vel_yaw([0, 0, -1], 0.0, 50)
        let_pass(autopilot, 3)
        before = len(autopilot.setpoints), len(autopilot.commands)
        backend = uav._connection._backend
        until(lambda: backend.dropped >= 30)  # MAVSDK repeats the setpoint for 1.5 s
        assert (len(autopilot.setpoints), len(autopilot.commands)) == before
