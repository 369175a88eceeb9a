"""Colours and fonts of films and pictures."""

from __future__ import annotations

import colorsys
import functools

from PIL import ImageFont

from arena.render.airframe import Paint

Colour = tuple[int, int, int]

SKY_TOP: Colour = (17, 22, 33)
SKY_BOTTOM: Colour = (38, 47, 64)
FLOOR: Colour = (66, 77, 97)
WALL: Colour = (44, 54, 72)
GRID: Colour = (86, 99, 122)
GRID_MAJOR: Colour = (116, 131, 158)
EDGE: Colour = (142, 156, 184)
EDGE_ABOVE: Colour = (74, 86, 108)
FENCE: Colour = (176, 136, 74)
SHADOW: Colour = (16, 20, 30)
TEXT: Colour = (236, 240, 247)
TEXT_DIM: Colour = (168, 180, 202)
TAG: Colour = (14, 18, 28)

BLADE: Colour = (235, 240, 248)

_FEW: tuple[Colour, ...] = (
    (64, 169, 255),
    (255, 138, 61),
    (82, 214, 122),
    (255, 92, 122),
    (188, 140, 255),
    (255, 209, 71),
    (45, 212, 209),
    (246, 130, 214),
    (178, 222, 84),
    (160, 174, 200),
)
"""Colours of up to ten vehicles. Neighbours in the list differ in brightness too."""
_PAINTS: dict[Paint, Colour] = {
    "body": (214, 220, 230),
    "arm": (150, 160, 178),
    "motor": (92, 102, 120),
    "leg": (136, 146, 164),
}


def vehicle_colours(count: int) -> tuple[Colour, ...]:
    """Return one colour per vehicle. For more than ten vehicles the colours form a rainbow."""
    if count <= len(_FEW):
        return _FEW[:count]
    rgb = [colorsys.hls_to_rgb(0.92 * k / count, 0.64, 0.88) for k in range(count)]
    return tuple((round(255 * r), round(255 * g), round(255 * b)) for r, g, b in rgb)


def paint_colour(paint: Paint, vehicle: Colour) -> Colour:
    """Return the colour of a face of a vehicle under full light.

    vehicle: colour of the vehicle, which its canopy, front arms and rotor discs have.
    """
    return _PAINTS.get(paint, vehicle)


def mixed(first: Colour, second: Colour, share: float) -> Colour:
    """Return the colour between two colours, mixed by a given share.

    share: 0 for the first colour, 1 for the second.
    """
    a, b = first, second
    return (
        round(a[0] + share * (b[0] - a[0])),
        round(a[1] + share * (b[1] - a[1])),
        round(a[2] + share * (b[2] - a[2])),
    )


@functools.cache
def font(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the font of all texts. Pillow contains this font.

    size_px: height of the font [px].
    """
    return ImageFont.load_default(size_px)
