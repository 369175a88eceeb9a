"""Surfaces and edges of the shapes of obstacles, at unit scale (-1 to 1 on each axis), as numpy arrays. Pure.

This module is separate from `arena.obstacles`, because `arena check` reads obstacles without numpy.
"""

from __future__ import annotations

import itertools
import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from arena.geometry import Array
from arena.portable_math import cos, sin

Shape = Literal["box", "cylinder", "sphere"]
_SIDES, _RINGS = 24, 8


def unit_mesh(shape: Shape) -> tuple[Array, NDArray[np.int_]]:
    """Return the surface of a unit shape (-1 to 1): vertices [-] (V, 3), triangles of vertex indices (F, 3)."""
    return {"box": _box, "cylinder": _cylinder, "sphere": _sphere}[shape]()


def unit_edges(shape: Shape) -> Array:
    """Return lines that show a unit shape (-1 to 1): both ends of each line [-] (E, 2, 3)."""
    return {"box": _box_edges, "cylinder": _cylinder_edges, "sphere": _sphere_edges}[shape]()


def _circle(sides: int) -> Array:
    angle = 2.0 * math.pi * np.arange(sides) / sides
    return np.stack([cos(angle), sin(angle)], axis=1)


def _box() -> tuple[Array, NDArray[np.int_]]:
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def _cylinder() -> tuple[Array, NDArray[np.int_]]:
    ring = _circle(_SIDES)
    ends = [np.insert(ring, 2, level, axis=1) for level in (-1.0, 1.0)]
    vertices = np.concatenate([*ends, [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]])
    top, bottom = 2 * _SIDES, 2 * _SIDES + 1
    faces = []
    for k in range(_SIDES):
        a, b = k, (k + 1) % _SIDES
        faces += [
            (a, b, b + _SIDES),
            (a, b + _SIDES, a + _SIDES),
            (top, b, a),
            (bottom, a + _SIDES, b + _SIDES),
        ]
    return vertices, np.array(faces)


def _sphere() -> tuple[Array, NDArray[np.int_]]:
    ring = _circle(_SIDES)
    levels = [math.pi * (k / _RINGS - 0.5) for k in range(1, _RINGS)]
    rings = [np.insert(math.cos(a) * ring, 2, math.sin(a), axis=1) for a in levels]
    vertices = np.concatenate([*rings, [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]])
    low, high, last = len(vertices) - 2, len(vertices) - 1, (_RINGS - 2) * _SIDES
    faces = []
    for k in range(_SIDES):
        a, b = k, (k + 1) % _SIDES
        faces += [(low, b, a), (high, last + a, last + b)]
        for r in range(_RINGS - 2):
            at = r * _SIDES
            faces += [(at + a, at + b, at + _SIDES + b), (at + a, at + _SIDES + b, at + _SIDES + a)]
    return vertices, np.array(faces)


def _box_edges() -> Array:
    corners = _box()[0]
    pairs = itertools.combinations(corners, 2)
    return np.array([pair for pair in pairs if np.count_nonzero(pair[0] != pair[1]) == 1])


def _cylinder_edges() -> Array:
    ends = [np.insert(_circle(_SIDES), 2, level, axis=1) for level in (-1.0, 1.0)]
    sides = np.stack(ends, axis=1)[:: _SIDES // 4]
    return np.concatenate([*(_closed(ring) for ring in ends), sides])


def _sphere_edges() -> Array:
    ring = np.insert(_circle(_SIDES), 2, 0.0, axis=1)
    return np.concatenate([_closed(ring[:, order]) for order in ([0, 1, 2], [0, 2, 1], [2, 0, 1])])


def _closed(ring: Array) -> Array:
    return np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
