"""Keys of the emulated relative sensors: forms of `neighbours`, merge with `defaults`."""

from __future__ import annotations

from pathlib import Path

import pytest

from arena.schema import Arena, load_arena

VEHICLES = "  uav2: {start: {position: [1, 0, 0]}}\n  uav3: {start: {position: [2, 0, 0]}}\n"


def loaded(folder: Path, text: str) -> Arena:
    (folder / "arena.yaml").write_text(text)
    return load_arena(folder / "arena.yaml")


def test_list_of_neighbours_has_the_default_sensor(tmp_path: Path) -> None:
    arena = loaded(tmp_path, "vehicles:\n  uav1: {neighbours: [uav3, uav2]}\n" + VEHICLES)
    v = arena.vehicle("uav1")
    assert v.neighbours == ("uav3", "uav2") and v.has_sensors
    sensor = v.neighbour_sensor
    assert (sensor.source, sensor.rate_hz) == ("mocap", 50.0)
    assert (sensor.noise.position_m, sensor.noise.velocity_m_s) == (0.004, 0.004)
    assert not arena.vehicle("uav2").has_sensors


def test_list_of_a_vehicle_is_merged_with_the_settings_of_defaults(tmp_path: Path) -> None:
    text = (
        "defaults: {neighbours: {source: estimator, rate_hz: 20}}\nvehicles:\n  uav1: {neighbours: [uav2]}\n"
    )
    v = loaded(tmp_path, text + VEHICLES).vehicle("uav1")
    assert (v.neighbours, v.neighbour_sensor.source, v.neighbour_sensor.rate_hz) == (
        ("uav2",),
        "estimator",
        20.0,
    )


def test_neighbours_of_defaults_do_not_contain_the_vehicle_itself(tmp_path: Path) -> None:
    text = "defaults: {neighbours: [uav1, uav2, uav3]}\nvehicles:\n  uav1: {}\n"
    arena = loaded(tmp_path, text + VEHICLES)
    assert arena.vehicle("uav2").neighbours == ("uav1", "uav3")


def test_beacon_sensor_of_a_vehicle_is_merged_with_defaults(tmp_path: Path) -> None:
    text = (
        "beacons: {door: [3, -1, -2], window: [-3, 1, -2]}\n"
        "defaults: {beacon_sensor: {rate_hz: 5, max_range_m: 4}}\n"
        "vehicles:\n  uav1: {beacon_sensor: {beacons: [window], noise: {range_m: 0.2}}}\n"
    )
    arena = loaded(tmp_path, text)
    sensor = arena.vehicle("uav1").beacon_sensor
    assert sensor is not None and arena.beacons == {"door": (3.0, -1.0, -2.0), "window": (-3.0, 1.0, -2.0)}
    assert (sensor.rate_hz, sensor.max_range_m, sensor.beacons) == (5.0, 4.0, ("window",))
    assert (sensor.noise.range_m, sensor.noise.bearing_deg) == (0.2, 1.0)


@pytest.mark.parametrize("key", ["neighbours: []", "neighbours: null", "gps: false"])
def test_vehicle_without_neighbours_has_no_sensor(tmp_path: Path, key: str) -> None:
    assert not loaded(tmp_path, f"vehicles:\n  uav1: {{{key}}}\n").vehicle("uav1").has_sensors
