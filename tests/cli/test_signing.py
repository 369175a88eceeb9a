"""`arena signing`: new keys, and the key exchange over a serial device."""

import os
import threading
import tty

import pytest
from pymavlink.dialects.v20 import common as mavlink

from arena.cli import main
from arena.signing_key import read_key
from arena.wire.mavlink_codec import Codec
from arena.wire.mavlink_frame import Stream
from arena.wire.mavlink_signing import SETUP_SIGNING, FrameSigner

YAML = """
mocap: {{source: natnet, server: 10.0.0.2}}
vehicles:
  uav1: {{id: 7, autopilot: hardware, profile: iris, url: "{url}", px4_version: "{version}", signing: {{key_file: uav1.key}}}}
"""


class Board:
    """An autopilot at the end of a serial cable, which signs after SETUP_SIGNING. device: the other end of the cable"""

    def __init__(self):
        self.fd, slave = os.openpty()
        tty.setraw(self.fd)
        tty.setraw(slave)
        self.device, self._slave = os.ttyname(slave), slave
        self.key, self._over = None, threading.Event()
        os.set_blocking(self.fd, False)
        self._thread = threading.Thread(target=self._run)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join(10)
        os.close(self.fd)
        os.close(self._slave)

    def _run(self):
        codec, stream = Codec(7, 1), Stream()
        while not self._over.wait(0.05):
            try:
                data, found = stream.feed(os.read(self.fd, 4096))
            except OSError:
                data, found = b"", stream.feed(b"")[1]
            for frame in found.frames:
                if frame.msgid == SETUP_SIGNING:
                    (m,) = codec.parse(data[frame.start : frame.end])
                    self.key = bytes(m.secret_key)
            beat = codec.pack(mavlink.MAVLink_heartbeat_message(2, 12, 1, 0, 4, 3))
            try:
                os.write(self.fd, FrameSigner(self.key, 0).sign(beat, 1.8e9) if self.key else beat)
            except OSError:
                continue


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["signing", "new", "uav1.key"]) == 0
    return tmp_path


def write_yaml(folder, url="udpin:0.0.0.0:14540", version="1.18"):
    (folder / "arena.yaml").write_text(YAML.format(url=url, version=version))


def test_new_prints_the_path_and_not_the_key(folder, capsys) -> None:
    assert main(["signing", "new", "other.key"]) == 0
    assert read_key(folder / "other.key").hex() not in capsys.readouterr().out
    assert main(["signing", "new", "other.key"]) == 2
    assert "is not replaced" in capsys.readouterr().err


def test_setup_over_udp_is_refused_with_the_reason(folder, capsys) -> None:
    write_yaml(folder)
    assert main(["signing", "setup", "uav1"]) == 2
    said = capsys.readouterr().err
    assert "uav1: got udpin 0.0.0.0:14540, expected a serial connection" in said and "plain text" in said
    assert main(["signing", "setup", "uav1", "--url", "udpout:10.0.0.7:14550"]) == 2


def test_setup_over_a_serial_device_gives_the_key(folder, capsys) -> None:
    write_yaml(folder)
    with Board() as board:
        assert main(["signing", "setup", "uav1", "--url", f"serial:{board.device}"]) == 0
        assert "uav1: the vehicle has the new key and signs its messages" in capsys.readouterr().out
        assert board.key == read_key(folder / "uav1.key")
        assert main(["signing", "setup", "uav1", "--url", f"serial:{board.device}"]) == 0
        assert "uav1: the vehicle already had this key and signs" in capsys.readouterr().out


def test_px4_version_that_does_not_sign_is_refused(folder, capsys) -> None:
    write_yaml(folder, version="1.16")
    assert main(["check", "--no-machine"]) == 2
    assert "got PX4 1.16, which does not sign messages; expected 1.18 or newer" in capsys.readouterr().err
