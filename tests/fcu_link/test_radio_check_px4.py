"""A real PX4 (SIH, without a simulator) reports its transmitter as `RadioCheck` expects. Review fault 1."""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink import mavutil

from arena.fcu_link.radio_check import RadioCheck
from arena.schema.px4 import find_px4

pytestmark = [pytest.mark.px4, pytest.mark.flight]
INSTANCE = 60 + os.getpid() % 100
PARAMS = {"COM_RC_IN_MODE": 0, "RC_MAP_KILL_SW": 7, "RC_CHAN_CNT": 8} | {
    f"RC_MAP_{axis}": k for k, axis in enumerate(("ROLL", "PITCH", "THROTTLE", "YAW"), 1)
}
OFF, ON = 1000, 2000
TIMEOUT_S = 120.0


class Pilot:
    """A PX4 process and its transmitter (RC_CHANNELS_OVERRIDE, which PX4 treats as an RC receiver)."""

    def __init__(self) -> None:
        self.wire = mavutil.mavlink_connection(f"udpout:127.0.0.1:{18570 + INSTANCE}", source_system=255)
        self.check, self.kill = RadioCheck([0, 3]), 0
        self._next = 0.0

    def reasons(self) -> list[str]:
        return self.check.reasons(time.monotonic(), PARAMS)

    def until(self, *reasons: str) -> None:
        """Send and receive until the reasons are these."""
        end = time.monotonic() + TIMEOUT_S
        while self.reasons() != list(reasons):
            assert time.monotonic() < end, (self.reasons(), reasons)
            if time.monotonic() >= self._next:
                self._next = time.monotonic() + 0.05
                self.wire.mav.heartbeat_send(6, 8, 0, 0, 4)
                if self.kill:
                    channels = (1500, 1500, 1100, 1500, OFF, OFF, self.kill, OFF)
                    self.wire.mav.rc_channels_override_send(INSTANCE + 1, 1, *channels)
            message = self.wire.recv_match(blocking=True, timeout=0.02)
            if message is not None and message.get_srcSystem() == INSTANCE + 1:
                self.check.on_autopilot(message, time.monotonic())


@pytest.fixture
def pilot(tmp_path: Path) -> Iterator[Pilot]:
    px4 = find_px4(None)
    if px4 is None or px4.stand_in:
        pytest.skip("no PX4 is found: set PX4_HOME")
    argv = [*px4.argv, "-d", "-i", str(INSTANCE), "-w", str(tmp_path), px4.data]
    wanted = {f"PX4_PARAM_{name}": str(value) for name, value in PARAMS.items()}
    env = os.environ | wanted | {"PX4_SIMULATOR": "sihsim", "PX4_SIM_MODEL": "sihsim_quadx"}
    with (tmp_path / "output.txt").open("w") as log:
        process = subprocess.Popen(argv, env=env, stdout=log, stderr=log, cwd=tmp_path)
    made = Pilot()
    yield made
    made.wire.close()
    process.kill()
    process.wait()


def test_px4_reports_the_signal_and_the_kill_switch(pilot: Pilot) -> None:
    no_signal, test = "no RC signal: is the transmitter on?", "test the kill switch: on for 2 s, then off"
    pilot.until(no_signal)
    pilot.kill = OFF
    pilot.until(test)
    pilot.kill = ON
    pilot.until("kill switch is on")
    pilot.kill = OFF
    pilot.until()
    pilot.kill = 0
    pilot.until(no_signal)
    pilot.kill = OFF
    pilot.until()
