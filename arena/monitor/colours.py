"""Colours of the live page, as RGB values from 0 to 255. Pure."""

from __future__ import annotations

import colorsys

from arena.live_view.settings import Kind

Rgb = tuple[int, int, int]

KINDS: dict[Kind, Rgb] = {"simulated": (56, 152, 255), "real": (255, 138, 31), "replayed": (178, 116, 255)}
"""Colour of a vehicle by the origin of its motion."""
SETPOINT: Rgb = (61, 220, 132)
PATH: Rgb = (236, 239, 246)
FENCE: Rgb = (176, 64, 64)
ROOM: Rgb = (94, 108, 132)
GRID: Rgb = (52, 62, 80)
SECTION: Rgb = (74, 88, 112)
FLOOR: Rgb = (22, 27, 37)
FLOOR_DARK, SKY_DARK = (10, 13, 20), (24, 32, 48)
GOOD, WARN, BAD, DIM = "#3ddc84", "#facc15", "#f87171", "#8b97ab"


def trail(row: int) -> Rgb:
    """Return the colour of a vehicle's trail. Vehicles with neighbouring indices get different hues.

    row: index of the vehicle.
    """
    red, green, blue = colorsys.hls_to_rgb((0.55 + 0.618034 * row) % 1.0, 0.5, 0.95)
    return int(255 * red), int(255 * green), int(255 * blue)


def css(rgb: Rgb) -> str:
    """Return a colour as text for CSS, such as `#3898ff`."""
    return "#{:02x}{:02x}{:02x}".format(*rgb)
