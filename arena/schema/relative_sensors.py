"""The YAML keys of the emulated relative sensors of a vehicle: `neighbours` and `beacon_sensor`."""

from typing import Annotated, Any, Literal

from pydantic import Field

from arena.schema.base import NotNegative, Positive, Strict

SensorSource = Literal["mocap", "estimator"]
SensorRate = Annotated[float, Field(ge=1, le=250)]


class NeighbourNoise(Strict):
    """Noise of the emulated neighbour sensor, as rms per axis."""

    position_m: NotNegative = 0.004
    """Noise of a relative position [m]."""
    velocity_m_s: NotNegative = 0.004
    """Noise of a relative velocity [m/s]."""


class Neighbours(Strict):
    """Emulated sensor that measures positions and velocities of other vehicles relative to the vehicle."""

    vehicles: tuple[str, ...] = ()
    """Names of the vehicles that the sensor measures."""
    source: SensorSource = "mocap"
    """Source of the measurements: motion capture, or the estimates of the autopilots (telemetry)."""
    rate_hz: SensorRate = 50.0
    """Measurements per second."""
    noise: NeighbourNoise = NeighbourNoise.model_construct()
    """Noise that the sensor adds."""


class BeaconNoise(Strict):
    """Noise of the emulated beacon sensor, as rms."""

    range_m: NotNegative = 0.05
    """Noise of a distance [m]."""
    bearing_deg: NotNegative = 1.0
    """Noise of azimuth and elevation [deg]."""


class BeaconSensor(Strict):
    """Emulated sensor that measures distance and direction of beacons.

    Directions are in body axes (FRD).
    """

    beacons: tuple[str, ...] | None = None
    """Names of the beacons that the sensor measures. Default: all `beacons` of the arena."""
    source: SensorSource = "mocap"
    """Source of the vehicle's own pose: motion capture, or the estimate of its autopilot (telemetry)."""
    rate_hz: SensorRate = 10.0
    """Measurements of each beacon per second."""
    noise: BeaconNoise = BeaconNoise.model_construct()
    """Noise that the sensor adds."""
    max_range_m: Positive = 20.0
    """Largest distance at which a beacon is measured [m]."""


def neighbours_value(value: Any) -> Any:
    """Return the value of the key `neighbours` as a mapping.

    A list contains the names of the vehicles.
    """
    if value is None or isinstance(value, (dict, Neighbours)):
        return value
    if isinstance(value, (list, tuple)):
        return {"vehicles": value}
    raise ValueError(
        "expected a list of vehicle names, or a mapping with the keys vehicles, source, rate_hz and noise"
    )
