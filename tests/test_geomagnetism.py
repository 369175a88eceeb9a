"""The magnetic field agrees with another implementation of the World Magnetic Model, and with PX4's declination parameter."""

from __future__ import annotations

import math

import pytest

from arena.geomagnetism import magnetic_field

# Computed with the package pygeomag 1.1.0 (WMM2025, 2025.0): latitude, longitude [deg], altitude [m]; north, east, down [nT].
PLACES = [
    ((47.397742, 8.545594, 488.0), (21519.9, 1286.8, 43242.4)),
    ((38.7, -9.1, 100.0), (26701.8, -536.9, 34966.4)),
    ((-33.9, 151.2, 20.0), (24010.4, 5454.1, -51434.0)),
    ((64.1, -21.9, 0.0), (12970.4, -2649.1, 50857.5)),
    ((0.0, 0.0, 9000.0), (27328.0, -1922.8, -15893.8)),
    ((35.7, 139.7, 40.0), (30110.4, -4164.0, 35636.5)),
    ((-54.8, -68.3, 0.0), (19179.9, 4002.2, -24336.7)),
    ((89.0, 10.0, 0.0), (2148.0, 770.9, 56709.3)),
]


@pytest.mark.parametrize(("place", "field_nt"), PLACES)
def test_field_agrees_with_another_implementation(place, field_nt):
    field = magnetic_field(*place)
    assert [1e5 * x for x in (field.north, field.east, field.down)] == pytest.approx(field_nt, abs=0.1)


def test_declination_inclination_and_strength_of_zurich():
    field = magnetic_field(47.397742, 8.545594, 488.0)
    assert math.degrees(field.declination_rad) == pytest.approx(3.422, abs=1e-3)
    assert math.degrees(field.inclination_rad) == pytest.approx(63.502, abs=1e-3)
    assert field.strength == pytest.approx(0.483184, abs=1e-6)


@pytest.mark.parametrize("lat_deg", [-90.0, 90.0])
def test_field_exists_at_the_poles(lat_deg):
    assert 0.5 < magnetic_field(lat_deg, 0.0, 0.0).strength < 0.7
