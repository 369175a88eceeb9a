"""Tests with MAVSDK 4: telemetry, actions, offboard, missions, geofence, parameters, failure injection."""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from end_to_end.flight import PATIENCE

from .site import Site

pytestmark = pytest.mark.flight
pytest.importorskip("mavsdk.asyncio", reason="client is not installed: mavsdk>=4")

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk  # noqa: E402
from mavsdk.asyncio.plugins.action import ActionAsync  # noqa: E402
from mavsdk.asyncio.plugins.failure import FailureAsync  # noqa: E402
from mavsdk.asyncio.plugins.ftp import FtpAsync  # noqa: E402
from mavsdk.asyncio.plugins.info import InfoAsync  # noqa: E402
from mavsdk.asyncio.plugins.log_files import LogFilesAsync  # noqa: E402
from mavsdk.asyncio.plugins.mission import MissionAsync  # noqa: E402
from mavsdk.asyncio.plugins.offboard import OffboardAsync  # noqa: E402
from mavsdk.asyncio.plugins.param import ParamAsync  # noqa: E402
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync  # noqa: E402
from mavsdk.exceptions import MavsdkError  # noqa: E402
from mavsdk.plugins.failure import FailureType, FailureUnit  # noqa: E402
from mavsdk.plugins.ftp import FtpResult  # noqa: E402
from mavsdk.plugins.log_files import LogFilesResult  # noqa: E402
from mavsdk.plugins.mission import MissionItem, MissionPlan  # noqa: E402
from mavsdk.plugins.offboard import (  # noqa: E402
    AccelerationNed,
    Attitude,
    AttitudeRate,
    PositionGlobalYaw,
    PositionNedYaw,
    VelocityBodyYawspeed,
    VelocityNedYaw,
)
from mavsdk.plugins.telemetry import FlightMode  # noqa: E402

LAT, LON = 47.397742, 8.545594


@dataclass
class Drone:
    """A connected MAVSDK vehicle and its plugins."""

    action: ActionAsync
    failure: FailureAsync
    files: FtpAsync
    info: InfoAsync
    logs: LogFilesAsync
    mission: MissionAsync
    offboard: OffboardAsync
    param: ParamAsync
    telemetry: TelemetryAsync


@asynccontextmanager
async def connected(site: Site) -> AsyncIterator[Drone]:
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(site.sdk_url)
        system = await mavsdk.first_autopilot(timeout_s=PATIENCE * 30.0)
        assert system is not None, site.flight.said()
        drone = Drone(
            ActionAsync(system),
            FailureAsync(system),
            FtpAsync(system),
            InfoAsync(system),
            LogFilesAsync(system),
            MissionAsync(system),
            OffboardAsync(system),
            ParamAsync(system),
            TelemetryAsync(system),
        )
        await until(drone.telemetry.subscribe_health(), has_a_place)
        await drone.action.hold()  # in a mode that only comes down nothing may arm
        await until(drone.telemetry.subscribe_health(), may_fly)
        yield drone


def has_a_place(health: Any) -> bool:
    """Return whether MAVSDK reports a valid global position; a PX4 without GPS has none."""
    return health.is_local_position_ok and health.is_home_position_ok


def may_fly(health: Any) -> bool:
    return health.is_armable and has_a_place(health)


async def until(stream: Any, good: Callable[[Any], bool], limit_s: float = 40.0) -> Any:
    """Return the first value of a subscription that satisfies the condition."""
    seen: Any = None
    try:
        async with asyncio.timeout(PATIENCE * limit_s):
            async for seen in stream:
                if good(seen):
                    return seen
    except TimeoutError:
        pass
    raise AssertionError(f"not within {PATIENCE * limit_s} s; the last was {seen}")


async def eventually(check: Callable[[], bool], limit_s: float, tell: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE * limit_s
    while not check():
        assert time.monotonic() < deadline, tell()
        await asyncio.sleep(0.02)


def fly(site: Site, what: Callable[[Drone], Awaitable[None]], limit_s: float = 120.0) -> None:
    """Run a program on a landed vehicle and leave the vehicle landed."""

    async def run() -> None:
        async with asyncio.timeout(PATIENCE * limit_s), connected(site) as drone:
            try:
                await what(drone)
            finally:
                if await drone.telemetry.armed():
                    with suppress(MavsdkError):
                        await drone.action.land()
                await until(drone.telemetry.subscribe_armed(), lambda armed: not armed)

    site.ready()
    asyncio.run(run())
    site.down()


def near(site: Site, n: float, e: float, d: float, within: float = 0.35) -> Callable[[], bool]:
    return lambda: float(np.linalg.norm(site.position() - [n, e, d])) < within


async def up_in_offboard(drone: Drone, site: Site, height: float = 2.0) -> None:
    await drone.offboard.set_position_ned(PositionNedYaw(0.0, 0.0, -height, 0.0))
    await drone.action.arm()
    await drone.offboard.start()
    await eventually(near(site, 0, 0, -height), 20, site.position)


def test_mavsdk_telemetry_reports_position_and_health(site: Site) -> None:
    async def look(drone: Drone) -> None:
        t = drone.telemetry
        health = await until(t.subscribe_health(), lambda h: h.is_armable)
        assert health.is_home_position_ok and health.is_local_position_ok
        assert health.is_global_position_ok == (site.kind == "builtin")
        position = await until(t.subscribe_position(), lambda p: math.isfinite(p.latitude_deg))
        assert abs(position.latitude_deg - LAT) < 1e-5 and abs(position.longitude_deg - LON) < 1e-5
        home = await until(t.subscribe_home(), lambda h: h.latitude_deg != 0)
        assert (
            abs(home.latitude_deg - LAT) < 1e-5
            and abs(home.absolute_altitude_m - position.absolute_altitude_m) < 1.0
        )
        assert not await until(t.subscribe_in_air(), lambda _: True)
        euler = await until(t.subscribe_attitude_euler(), lambda _: True)
        assert abs(euler.roll_deg) < 3 and abs(euler.pitch_deg) < 3
        local = await until(t.subscribe_position_velocity_ned(), lambda _: True)
        assert abs(local.position.down_m) < 0.3
        battery = await until(
            t.subscribe_battery(), lambda b: math.isfinite(b.current_battery_a)
        )  # in BATTERY_STATUS alone
        assert (
            battery.id == 0 and 9.0 < battery.voltage_v < 17.0 and 80.0 < battery.remaining_percent <= 100.0
        )

    fly(site, look)


def test_mavsdk_parameters_are_read_and_written(site: Site) -> None:
    async def tune(drone: Drone) -> None:
        p = drone.param
        await p.set_param_float("MPC_XY_CRUISE", 4.0)
        assert await p.get_param_float("MPC_XY_CRUISE") == pytest.approx(4.0)
        await p.set_param_int("SYS_FAILURE_EN", 1)
        assert await p.get_param_int("SYS_FAILURE_EN") == 1
        with pytest.raises(MavsdkError):
            await p.get_param_int("MPC_XY_CRUISE")
        with pytest.raises(MavsdkError):
            await p.get_param_float("NO_SUCH_PARAM")
        await drone.action.set_takeoff_altitude(2.0)
        assert await drone.action.get_takeoff_altitude() == pytest.approx(2.0)

    fly(site, tune)


def test_mavsdk_actions_take_off_goto_hold_and_return(site: Site) -> None:
    async def act(drone: Drone) -> None:
        a, t = drone.action, drone.telemetry
        await a.set_takeoff_altitude(2.0)
        await a.arm()
        await a.takeoff()
        await until(t.subscribe_flight_mode(), lambda m: m == FlightMode.HOLD)
        await eventually(near(site, 0, 0, -2.0, 0.6), 10, site.position)
        lat = LAT + math.degrees(3.0 / 6_371_000.0)
        home = await until(t.subscribe_home(), lambda h: h.latitude_deg != 0)
        await a.goto_location(lat, LON, home.absolute_altitude_m + 2.0, 0.0)
        await eventually(near(site, 3, 0, -2.0, 0.4), 25, site.position)
        await a.hold()
        await a.return_to_launch()
        await until(t.subscribe_flight_mode(), lambda m: m == FlightMode.RETURN_TO_LAUNCH)
        await until(t.subscribe_armed(), lambda armed: not armed, 60)
        assert np.hypot(*site.position()[:2]) < 1.0

    fly(site, act)


def test_mavsdk_invalid_requests_are_refused(site: Site) -> None:
    async def try_it(drone: Drone) -> None:
        with pytest.raises(MavsdkError):
            await drone.offboard.start()

    fly(site, try_it)


def test_mavsdk_reads_files_logs_and_flight_information(site: Site, tmp_path: Path) -> None:
    async def read(drone: Drone) -> None:
        assert (await drone.files.list_directory("/")).entries
        suffix = "" if site.kind == "builtin" else ".xz"
        general = f"/etc/extras/component_general.json{suffix}"
        for burst in (False, True):
            async for result, _ in drone.files.download(general, str(tmp_path), burst):
                if result == FtpResult.SUCCESS:
                    break
            assert (tmp_path / Path(general).name).stat().st_size > 50
        with pytest.raises(MavsdkError):
            await drone.files.list_directory("/no/such/folder")
        await drone.action.arm()
        info = drone.info.subscribe_flight_information()
        await until(info, lambda i: i.duration_since_arming_ms > 0)
        await drone.action.disarm()
        deadline = time.monotonic() + PATIENCE * 20.0
        while not (entries := [e for e in await drone.logs.get_entries() if e.size_bytes > 2000]):
            assert time.monotonic() < deadline
        async for result, _ in drone.logs.download_log_file(entries[-1], str(tmp_path / "log.ulg")):
            if result == LogFilesResult.SUCCESS:
                break
        assert (tmp_path / "log.ulg").read_bytes()[:4] == b"ULog"

    fly(site, read)


def test_mavsdk_offboard_flies_every_setpoint_type(site: Site) -> None:
    async def offboard(drone: Drone) -> None:
        o, t = drone.offboard, drone.telemetry
        await up_in_offboard(drone, site)
        await o.set_position_ned(PositionNedYaw(1.5, 0.0, -2.0, 0.0))
        await eventually(near(site, 1.5, 0, -2.0), 15, site.position)
        await o.set_velocity_ned(VelocityNedYaw(0.0, 1.0, 0.0, 90.0))
        await eventually(lambda: site.position()[1] > 1.5, 10, site.position)
        await o.set_velocity_body(VelocityBodyYawspeed(0.0, 0.0, -0.5, 20.0))
        await eventually(lambda: site.position()[2] < -2.5, 10, site.position)
        await o.set_position_ned(PositionNedYaw(0.0, 0.0, -3.0, 0.0))
        await eventually(near(site, 0, 0, -3.0), 20, site.position)
        await o.set_position_velocity_ned(
            PositionNedYaw(1.0, 0.0, -3.0, 0.0), VelocityNedYaw(0.0, 0.0, 0.0, 0.0)
        )
        await eventually(near(site, 1, 0, -3.0), 15, site.position)
        await o.set_position_velocity_acceleration_ned(
            PositionNedYaw(0.0, 1.0, -3.0, 0.0),
            VelocityNedYaw(0.0, 0.0, 0.0, 0.0),
            AccelerationNed(0.0, 0.0, 0.0),
        )
        await eventually(near(site, 0, 1, -3.0), 15, site.position)
        await o.set_position_global(
            PositionGlobalYaw(LAT, LON, 3.0, 0.0, PositionGlobalYaw.AltitudeType.REL_HOME)
        )
        await eventually(near(site, 0, 0, -3.0), 15, site.position)
        hover = await drone.param.get_param_float("MPC_THR_HOVER")
        north = site.position()[0]
        await o.set_attitude(Attitude(0.0, -6.0, 0.0, hover))
        await eventually(lambda: site.position()[0] > north + 0.4, 5, site.position)
        await o.set_position_ned(PositionNedYaw(0.0, 0.0, -3.0, 0.0))
        await eventually(near(site, 0, 0, -3.0), 15, site.position)
        await o.set_attitude_rate(AttitudeRate(0.0, 0.0, 40.0, hover))
        await until(t.subscribe_attitude_euler(), lambda a: a.yaw_deg > 15, 3)
        await o.set_acceleration_ned(AccelerationNed(0.0, -1.0, 0.0))
        await eventually(lambda: site.position()[1] < -0.4, 5, site.position)
        await o.set_position_ned(PositionNedYaw(0.0, 0.0, -1.5, 0.0))
        await eventually(near(site, 0, 0, -1.5), 20, site.position)
        assert await o.is_active()
        await o.stop()
        await until(t.subscribe_flight_mode(), lambda m: m == FlightMode.HOLD, 5)

    fly(site, offboard)


def at(north: float, east: float, up: float, **more: Any) -> MissionItem:
    lat = LAT + math.degrees(north / 6_371_000.0)
    lon = LON + math.degrees(east / (6_371_000.0 * math.cos(math.radians(LAT))))
    given = {"speed_m_s": 2.0, "is_fly_through": False, "acceptance_radius_m": 0.4, **more}
    return MissionItem(lat, lon, up, **given)


def test_mavsdk_mission_is_uploaded_flown_paused_and_cleared(site: Site) -> None:
    async def mission(drone: Drone) -> None:
        m, t = drone.mission, drone.telemetry
        plan = [at(0, 0, 2), at(3, 0, 2), at(3, 3, 2)]
        await m.upload_mission(MissionPlan(plan))
        back = await m.download_mission()
        assert [round(i.relative_altitude_m, 2) for i in back.mission_items] == [2.0] * 3
        assert abs(back.mission_items[1].latitude_deg - plan[1].latitude_deg) < 2e-7
        await drone.action.arm()
        await m.start_mission()
        await until(t.subscribe_flight_mode(), lambda x: x == FlightMode.MISSION)
        await eventually(lambda: site.position()[0] > 1.0, 40, site.position)
        await m.pause_mission()
        await until(t.subscribe_flight_mode(), lambda x: x == FlightMode.HOLD)
        await m.start_mission()
        await until(m.subscribe_mission_progress(), lambda p: p.current == p.total == 3, 60)
        assert await m.is_mission_finished()
        await eventually(near(site, 3, 3, -2.0, 0.8), 10, site.position)
        await m.clear_mission()

    fly(site, mission)


def test_mavsdk_failure_injection(site: Site) -> None:
    async def fail(drone: Drone) -> None:
        f, p = drone.failure, drone.param
        if site.kind == "builtin":  # PX4 v1.16 looks at it for its own console alone, not for MAVLink
            await p.set_param_int("SYS_FAILURE_EN", 0)
            with pytest.raises(MavsdkError):
                await f.inject(FailureUnit.SENSOR_GPS, FailureType.OFF, 0)
        await p.set_param_int("SYS_FAILURE_EN", 1)
        for unit in (
            FailureUnit.SENSOR_GPS,
            FailureUnit.SENSOR_BARO,
            FailureUnit.SENSOR_MAG,
            FailureUnit.SYSTEM_BATTERY,
            FailureUnit.SYSTEM_MOTOR,
        ):
            await f.inject(unit, FailureType.OFF, 0)
            await f.inject(unit, FailureType.OK, 0)
        with pytest.raises(MavsdkError):
            await f.inject(FailureUnit.SENSOR_GPS, FailureType.GARBAGE, 0)

    fly(site, fail)
