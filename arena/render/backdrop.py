"""The empty room behind the vehicles: sky, floor with a grid, far walls and edges.

It is drawn once per camera position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from arena.geometry import Array
from arena.obstacles import Obstacle
from arena.render import style
from arena.render.camera import NEAR_M, Camera, clip

MAX_GRID_LINES = 80
"""Most grid lines per direction. In larger rooms the lines are 5 m apart, or more."""


@dataclass(frozen=True, kw_only=True)
class Room:
    """Box-shaped room with its floor at D = 0 [NED].

    low, high: north and east of its corners [m] [NED] (2,).
    height_m: [m]; None: unknown.
    fence: two opposite corners of the geofence [m] [NED] (2, 3); None without a geofence.
    obstacles: fixed bodies in the room.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    height_m: float | None
    fence: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    obstacles: tuple[Obstacle, ...] = ()

    @property
    def floor(self) -> Array:
        """Corners of the floor [m] [NED] (4, 3): southwest, southeast, northeast, northwest."""
        (n0, e0), (n1, e1) = self.low, self.high
        return np.array([(n0, e0, 0), (n0, e1, 0), (n1, e1, 0), (n1, e0, 0)], float)


def grid_step_m(room: Room) -> float:
    """Return the distance between the grid lines on the floor [m]: 1, 5, 10, 50 ...

    Larger rooms get larger distances, so that there are at most MAX_GRID_LINES lines.
    """
    longest, step, factors = max(np.subtract(room.high, room.low)), 1.0, (5.0, 2.0)
    k = 0
    while longest / step > MAX_GRID_LINES:
        step, k = step * factors[k % 2], k + 1
    return float(step)


def backdrop(room: Room, camera: Camera, line_px: float) -> tuple[Image.Image, Image.Image]:
    """Return the picture of the empty room, and a mask of the pixels that show its floor.

    camera: camera with the size of the picture.  line_px: width of thin lines [px].
    """
    picture = _sky(camera)
    draw = ImageDraw.Draw(picture)
    mask = Image.new("L", picture.size)
    _walls(draw, room, camera, line_px)
    floor = clip(camera, room.floor, closed=True)
    if len(floor) >= 3:
        corners = [tuple(p) for p in camera.project(floor)]
        ImageDraw.Draw(mask).polygon(corners, fill=255)
        picture.paste(_floor_shade(picture, camera, room), mask=mask)
        _grid(draw, room, camera, line_px)
    line(draw, camera, room.floor, style.EDGE, 1.6 * line_px, closed=True)
    _fence(draw, room, camera, line_px)
    _compass(draw, room, camera, line_px)
    return picture, mask


def line(
    draw: ImageDraw.ImageDraw,
    camera: Camera,
    points_n: Array,
    colour: style.Colour | tuple[int, int, int, int],
    width_px: float,
    *,
    closed: bool = False,
) -> None:
    """Draw a line through points in the room.

    points_n: [m] [NED] (n, 3).
    closed: connect the last point with the first.
    """
    points = clip(camera, np.concatenate([points_n, points_n[:1]]) if closed else points_n, closed=False)
    if len(points) >= 2:
        draw.line([tuple(p) for p in camera.project(points)], fill=colour, width=max(1, round(width_px)))


def _sky(camera: Camera) -> Image.Image:
    share = np.linspace(0.0, 1.0, camera.height)[:, None] ** 0.8
    rows = np.array(style.SKY_TOP) + share * (np.array(style.SKY_BOTTOM) - np.array(style.SKY_TOP))
    return Image.fromarray(
        np.broadcast_to(np.rint(rows)[:, None], (camera.height, camera.width, 3)).astype(np.uint8)
    )


def _floor_shade(picture: Image.Image, camera: Camera, room: Room) -> Image.Image:
    """Return the floor's colour for every pixel, brightest at the centre of the floor."""
    centre = np.array([*(np.add(room.low, room.high) / 2), 0.0])
    half = 0.5 * float(np.hypot(*np.subtract(room.high, room.low)))
    small = (picture.width // 8, picture.height // 8)
    at = camera.project(centre)
    radius = half * camera.pixels_per_metre(centre)
    x = (np.arange(small[0]) * 8 - at[0]) / radius
    y = (np.arange(small[1]) * 8 - at[1]) / (0.6 * radius)
    light = 1.12 - 0.40 * np.clip(np.hypot(x[None, :], y[:, None]), 0.0, 1.2)
    shade = np.clip(light[..., None] * np.array(style.FLOOR), 0, 255).astype(np.uint8)
    return Image.fromarray(shade).resize(picture.size, Image.Resampling.BILINEAR)


def _grid(draw: ImageDraw.ImageDraw, room: Room, camera: Camera, line_px: float) -> None:
    step = grid_step_m(room)
    for axis in (0, 1):
        first, last = room.low[axis], room.high[axis]
        for k in range(int(np.ceil(first / step + 1e-6)), int(np.floor(last / step - 1e-6)) + 1):
            ends = np.zeros((2, 3))
            ends[:, axis] = k * step
            ends[:, 1 - axis] = room.low[1 - axis], room.high[1 - axis]
            major = k % 5 == 0
            line(draw, camera, ends, style.GRID_MAJOR if major else style.GRID, line_px)


def _walls(draw: ImageDraw.ImageDraw, room: Room, camera: Camera, line_px: float) -> None:
    """Draw the walls whose inner side faces the camera, and the edges of all walls and of the ceiling."""
    if room.height_m is None:
        return
    floor, up = room.floor, np.array([0.0, 0.0, -room.height_m])
    centre = floor.mean(axis=0)
    for i in range(4):
        a, b = floor[i], floor[(i + 1) % 4]
        wall = np.stack([a, b, b + up, a + up])
        inwards = centre - 0.5 * (a + b)
        if inwards @ (camera.eye - a) > 0.0 and len(corners := clip(camera, wall, closed=True)) >= 3:
            draw.polygon([tuple(p) for p in camera.project(corners)], fill=style.WALL)
    for corner in floor:
        line(draw, camera, np.stack([corner, corner + up]), style.EDGE_ABOVE, 1.2 * line_px)
    line(draw, camera, floor + up, style.EDGE_ABOVE, 1.2 * line_px, closed=True)


def _fence(draw: ImageDraw.ImageDraw, room: Room, camera: Camera, line_px: float) -> None:
    """Draw the edges of the geofence."""
    if room.fence is None:
        return
    (n0, e0, floor), (n1, e1, top) = room.fence
    corners = np.array([(n0, e0), (n0, e1), (n1, e1), (n1, e0)])
    low, high = (np.insert(corners, 2, down, axis=1) for down in (floor, top))
    for ring in (low, high):
        line(draw, camera, ring, style.FENCE, line_px, closed=True)
    for edge in np.stack([low, high], axis=1):
        line(draw, camera, edge, style.FENCE, line_px)


def _compass(draw: ImageDraw.ImageDraw, room: Room, camera: Camera, line_px: float) -> None:
    """Draw an arrow to the north in the middle of the floor's north edge, with the letter N."""
    size = 0.03 * float(min(np.subtract(room.high, room.low))) + 0.05
    edge = np.array([room.high[0], 0.5 * (room.low[1] + room.high[1]), 0.0])
    arrow = edge + size * np.array([(0.0, 0, 0), (-2.0, -0.8, 0), (-1.5, 0, 0), (-2.0, 0.8, 0)])
    letter = edge - (3.2 * size, 0.0, 0.0)
    if (camera.depth(np.concatenate([arrow, letter[None]])) > 2 * NEAR_M).all():
        draw.polygon([tuple(p) for p in camera.project(arrow)], fill=style.EDGE)
        at, text = camera.project(letter), style.font(round(12 * line_px / 2) * 2)
        draw.text((float(at[0]), float(at[1])), "N", fill=style.EDGE, font=text, anchor="mm")
