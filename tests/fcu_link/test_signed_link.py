"""The link process with a vehicle that signs as PX4 1.18 does: it starts with an old timestamp, and obeys only signed messages."""

import time

import pytest
from fake_autopilot import ARM, FakeAutopilot
from served import Connection, Served, UdpPort
from signing_autopilot import SigningAutopilot

from arena.signing_key import TimestampFile, read_key, write_new_key
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_signing import timestamp_at

from .link_rig import ID, POSE, UID, heartbeat, version
from .test_fcu_link_shell import Started, udp


@pytest.fixture
def autopilot():
    telemetry = ("HEARTBEAT", "SYS_STATUS", "ATTITUDE", "LOCAL_POSITION_NED")
    return FakeAutopilot(system=ID, uid2=UID, pos=POSE, telemetry=telemetry, ignore={ARM})


@pytest.fixture
def start(tmp_path):
    made = []

    def begin(**changes):
        made.append(Started(tmp_path, **changes))
        return made[-1]

    yield begin
    for one in made:
        one.end()


def test_signed_vehicle_is_served_and_an_unsigned_one_is_not(start, autopilot, tmp_path):
    file = tmp_path / "key"
    write_new_key(file)
    link, board = start(key_file=str(file)), SigningAutopilot(autopilot, read_key(file))
    intruder = udp((link.address, 14998))
    served = Served(
        [Connection(autopilot=board, port=UdpPort((link.address, 14999)), remote=(link.address, 14540))]
    )
    with served, intruder:

        def intrude():
            armed = [heartbeat(armed=True), version()]
            intruder.sendto(b"".join(Codec(ID, 1).pack(m) for m in armed), (link.address, 14540))

        link.until(lambda: link.ready and link.received("router", "HEARTBEAT"), intrude)
        link.until(lambda: "from the vehicle: not signed" in link.stats["dropped"], intrude)
        assert not any(m.base_mode & 128 for m in link.received("router", "HEARTBEAT"))
        assert "uav7: its messages have a valid signature" in link.events
        assert board.accepted and not board.refused
        link.until(lambda: TimestampFile(file).first() > timestamp_at(time.time() - 60.0))
    assert read_key(file).hex() not in link.out.read_text() + str(link.packets)


def test_vehicle_without_a_key_is_reported_and_not_connected(start, autopilot, tmp_path):
    file = tmp_path / "key"
    write_new_key(file)
    link = start(key_file=str(file))
    served = Served(
        [Connection(autopilot=autopilot, port=UdpPort((link.address, 14999)), remote=(link.address, 14540))]
    )
    with served:
        link.until(lambda: any("its messages are not signed: it has no key" in text for text in link.events))
    assert not link.ready and not link.received("router", "HEARTBEAT")
