"""Tests with pymavlink's tools: mavutil, mavparm and mavwp."""

from __future__ import annotations

import os
import struct
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from end_to_end.flight import PATIENCE, eventually

from .site import Site

pytestmark = pytest.mark.flight
os.environ.setdefault("MAVLINK20", "1")
from pymavlink import mavparm, mavutil, mavwp  # noqa: E402
from pymavlink.dialects.v20 import common as mavlink  # noqa: E402


class _Beat:
    """Send a ground station's heartbeat while the test runs."""

    def __init__(self, connection: Any) -> None:
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(connection,), daemon=True)
        self._thread.start()

    def _run(self, connection: Any) -> None:
        while not self._over.wait(0.5):
            connection.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)

    def close(self) -> None:
        self._over.set()
        self._thread.join(2.0)


def mission_starts(link: Any) -> bool:
    """Start a mission; retry while the autopilot still checks the uploaded items, as PX4 does."""
    link.mav.command_long_send(link.target_system, 1, mavlink.MAV_CMD_MISSION_START, 0, 0, 0, 0, 0, 0, 0, 0)
    answer = wait_for(link, "COMMAND_ACK", lambda m: m.command == mavlink.MAV_CMD_MISSION_START, 2)
    return answer is not None and bool(answer.result == mavlink.MAV_RESULT_ACCEPTED)


@pytest.fixture
def link(site: Site) -> Iterator[Any]:
    site.ready()
    connection = mavutil.mavlink_connection(
        f"udpout:{site.tools}", source_system=238, source_component=190, dialect="common"
    )
    beat = _Beat(connection)
    assert connection.wait_heartbeat(timeout=60) is not None
    connection.target_system, connection.target_component = site.vehicle, 1
    yield connection
    beat.close()
    connection.close()


def wait_for(link: Any, kind: str | list[str], good: Callable[[Any], bool], limit_s: float = 30.0) -> Any:
    """Return the first message of these types that satisfies the condition, or None."""
    deadline = time.monotonic() + PATIENCE * limit_s
    while time.monotonic() < deadline:
        m = link.recv_match(type=kind, blocking=True, timeout=1)
        if m is not None and good(m):
            return m
    return None


def ready(link: Any, limit_s: float = 60.0) -> None:
    """Return whether SYS_STATUS reports that the vehicle may arm."""
    link.set_mode("LOITER")
    bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
    assert wait_for(link, "SYS_STATUS", lambda m: bool(m.onboard_control_sensors_health & bit), limit_s)


def test_mavparm_sets_and_saves_parameters(link: Any, tmp_path: Path) -> None:
    params = mavparm.MAVParmDict()
    link.param_fetch_all()
    count = 1
    while len(params) < count:
        m = wait_for(link, "PARAM_VALUE", lambda m: m.param_index < 65535)
        assert m is not None, f"{len(params)} of {count} parameters"
        params[m.param_id], count = m.param_value, m.param_count
    assert params.mavset(link, "MPC_XY_CRUISE", 4.5, retries=5)
    assert params.mavset(link, "SYS_FAILURE_EN", 1, retries=5, parm_type=mavlink.MAV_PARAM_TYPE_INT32)
    link.param_fetch_one("SYS_FAILURE_EN")
    assert wait_for(
        link,
        "PARAM_VALUE",
        lambda m: (m.param_id, struct.pack("<f", m.param_value)) == ("SYS_FAILURE_EN", b"\1\0\0\0"),
    )
    params.save(str(tmp_path / "all.parm"))
    assert len((tmp_path / "all.parm").read_text().splitlines()) >= 0.9 * count


def test_pymavlink_arms_takes_off_by_mode_and_lands(link: Any, site: Site) -> None:
    ready(link)
    link.set_mode("TAKEOFF")
    link.arducopter_arm()
    link.motors_armed_wait()
    site.flight.until_up(1.0, 30)
    link.set_mode("LAND")
    link.motors_disarmed_wait()
    site.down()


def test_mavwp_mission_is_uploaded_and_flown(link: Any, site: Site) -> None:
    ready(link)
    loader = mavwp.MAVWPLoader(site.vehicle, 1)
    relative = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
    for seq, (command, up) in enumerate(((22, 3.0), (16, 3.0), (21, 0.0))):
        to, place = (site.vehicle, 1), (47.397742, 8.545594, up)
        loader.add(
            mavutil.mavlink.MAVLink_mission_item_message(
                *to, seq, relative, command, 0, 1, 0, 0.4, 0, 0, *place
            )
        )
    link.waypoint_count_send(loader.count())
    while m := wait_for(link, ["MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK"], lambda _: True):
        if m.get_type() == "MISSION_ACK":
            break
        link.mav.send(loader.wp(m.seq))
    assert m is not None and m.type == mavlink.MAV_MISSION_ACCEPTED
    eventually(lambda: mission_starts(link), 20, "a mission that starts", site.flight.said)
    site.flight.until_up(1.0, 40)
    reached: set[int] = set()

    def at_the_end() -> bool:
        m = link.recv_match(type="MISSION_ITEM_REACHED", blocking=True, timeout=1)
        reached.update({m.seq} if m else ())
        return reached >= {
            1,
            2,
        }  # the take-off's may be followed so soon by the next one's that PX4 tells that alone

    eventually(at_the_end, 60, "the last is reached", lambda: reached)
    site.down()
