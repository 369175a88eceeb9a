"""Simulated sensors, one module per kind of sensor.

The table `SENSORS` lists them by their key under a profile's `sensors:`. A new sensor needs a module here
with a class that implements `Sensor`, a row in this table, and a model of its profile keys in
`arena/schema/profile.py`. Pure: no sockets, no clocks. Random numbers come from seeded generators.
"""

from __future__ import annotations

from arena.sim.sensors.barometer import Barometer
from arena.sim.sensors.gps import Gps
from arena.sim.sensors.imu import Imu
from arena.sim.sensors.magnetometer import Magnetometer
from arena.sim.sensors.sensor import Channel, GlobalOrigin, Motion, Sensor, Site
from arena.sim.sensors.suite import SensorSuite
from arena.wire.hil import HilOutput

__all__ = ["SENSORS", "Channel", "GlobalOrigin", "Motion", "Sensor", "SensorSuite", "Site", "hil_outputs"]

SENSORS: dict[str, type[Sensor]] = {"imu": Imu, "mag": Magnetometer, "baro": Barometer, "gps": Gps}
"""Sensors by profile key."""


def hil_outputs() -> list[HilOutput]:
    """Return which data each sensor sends to PX4's simulator API (HIL messages), in the order of `SENSORS`.

    A sensor either fills fields of HIL_SENSOR or sends its own message, such as HIL_GPS.
    """
    return [sensor.hil for sensor in SENSORS.values()]
