"""Draws the obstacles of a room, and finds the obstacles that hide a vehicle from the camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from PIL import ImageDraw

from arena.geometry import Array
from arena.obstacles import Obstacle
from arena.render import style
from arena.render.camera import Camera, clip

_LIGHT = np.array([-0.35, -0.30, -0.89])  # direction to the light [NED], the same as in `picture`
_AMBIENT, _OPACITY = 0.45, 235
_STEPS = 40


def draw_obstacles(
    draw: ImageDraw.ImageDraw, camera: Camera, obstacles: Sequence[Obstacle], line_px: float
) -> None:
    """Draw the obstacles of a room, the farthest first.

    line_px: width of thin lines [px].
    """
    for one in sorted(obstacles, key=lambda o: -float(np.linalg.norm(np.subtract(o.centre_n, camera.eye)))):
        _draw(draw, camera, one, line_px)


def hiding(obstacles: Sequence[Obstacle], eye_n: Array, p_n: Array) -> list[Obstacle]:
    """Return the obstacles that hide a point from the camera.

    eye_n, p_n: [m] [NED] (3,).
    """
    share = np.linspace(0.0, 1.0, _STEPS)[:, None]
    found = []
    for one in obstacles:
        half = one.half_extents_n
        near, far = np.subtract(one.centre_n, half), np.add(one.centre_n, half)
        if (np.maximum(eye_n, p_n) < near).any() or (np.minimum(eye_n, p_n) > far).any():
            continue
        low, high = _span(eye_n, p_n, near, far)
        if low < high and any(
            np.linalg.norm(one.nearest(point) - point) < 1e-6
            for point in eye_n + (low + share * (high - low)) * (p_n - eye_n)
        ):
            found.append(one)
    return found


def _span(a: Array, b: Array, near: Array, far: Array) -> tuple[float, float]:
    """Return the points at which the line from a to b enters and leaves a box, as numbers from 0 (at a) to 1 (at b).

    near, far: corners of the box (3,).
    """
    way = np.where(np.abs(b - a) < 1e-12, 1e-12, b - a)
    ends = np.sort(np.stack([(near - a) / way, (far - a) / way]), axis=0)
    return max(0.0, float(ends[0].max())), min(1.0, float(ends[1].min()))


def _draw(draw: ImageDraw.ImageDraw, camera: Camera, one: Obstacle, line_px: float) -> None:
    points, faces = one.mesh()
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = ((corners.mean(axis=1) - np.array(one.centre_n)) * normals).sum(axis=1) > 0.0
    normals = np.where(outwards[:, None], normals, -normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    seen = ((camera.eye - corners[:, 0]) * normals).sum(axis=1) > 0.0
    light = _AMBIENT + (1.0 - _AMBIENT) * np.clip(normals @ _LIGHT, 0.0, 1.0)
    for k in np.flatnonzero(seen).tolist():
        shape = clip(camera, corners[k], closed=True)
        if len(shape) >= 3:
            red, green, blue = (round(c * float(light[k])) for c in one.rgb)
            draw.polygon([tuple(p) for p in camera.project(shape)], fill=(red, green, blue, _OPACITY))
    if one.shape != "box":
        return
    for edge in one.edges():
        if not hiding(
            (one,), camera.eye, edge.mean(axis=0) + 1e-3 * (edge.mean(axis=0) - np.array(one.centre_n))
        ):
            ends = clip(camera, edge, closed=False)
            if len(ends) == 2:
                colour = style.mixed(one.rgb, style.TEXT, 0.35)
                draw.line([tuple(p) for p in camera.project(ends)], fill=colour, width=max(1, round(line_px)))
