"""Obstacles of a room: boxes, cylinders and spheres that do not move. Pure.

The schema makes them from `world.obstacles`, and the slices of world, recorder and viewers contain them (`Obstacle.slice`).
Numpy is imported only for surfaces: `arena check` needs extents and distances alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from arena.geometry import Array

Shape = Literal["box", "cylinder", "sphere"]
Triple = tuple[float, float, float]
Rows = tuple[Triple, Triple, Triple]

SIZES: Mapping[Shape, tuple[str, ...]] = {
    "box": ("length", "width", "height"),
    "cylinder": ("diameter", "height"),
    "sphere": ("diameter",),
}
"""Numbers of the key `size` of each shape."""
DEFAULT_COLOUR = "#8d99ae"
_SWAPS = 200


@dataclass(frozen=True, kw_only=True)
class Obstacle:
    """Fixed body in the room: a box, a cylinder or a sphere.

    size_m: extents along its own axes forward, right, down [m]. A cylinder has its axis along down.
    centre_n: centre [m] [NED].  rpy_rad: roll, pitch, yaw [rad].  colour: `#rrggbb`.
    """

    name: str
    shape: Shape
    size_m: Triple
    centre_n: Triple
    rpy_rad: Triple = (0.0, 0.0, 0.0)
    colour: str = DEFAULT_COLOUR

    @property
    def r_nb(self) -> Rows:
        """Rotation matrix from the obstacle's own axes (FRD) to NED [-] (3, 3), as a tuple of rows."""
        return _rotation(self.rpy_rad)

    @property
    def q_nb(self) -> Array:
        """Attitude of the obstacle [-] wxyz (4,)."""
        from arena.geometry import quat_from_euler

        return quat_from_euler(self.rpy_rad)

    @property
    def half_extents_n(self) -> Triple:
        """Half size of the obstacle's bounding box along north, east and down [m]."""
        return half_extents(self.shape, self.size_m, self.rpy_rad)

    @property
    def rgb(self) -> tuple[int, int, int]:
        """Colour of the obstacle as red, green and blue, 0..255."""
        value = int(self.colour.removeprefix("#"), 16)
        return value >> 16 & 255, value >> 8 & 255, value & 255

    def slice(self) -> dict[str, Any]:
        """Return the obstacle as a JSON object, for the configuration (slice) of a process."""
        return {
            "name": self.name,
            "shape": self.shape,
            "size_m": list(self.size_m),
            "centre_n": list(self.centre_n),
            "rpy_rad": list(self.rpy_rad),
            "colour": self.colour,
        }

    def nearest(self, p_n: Sequence[float] | Array) -> Triple:
        """Return the point of the obstacle that is nearest to a point [m] [NED].

        p_n: [m] [NED] (3,). A point inside the solid obstacle is its own nearest point.
        """
        rows, (cn, ce, cd) = self.r_nb, self.centre_n
        away = float(p_n[0]) - cn, float(p_n[1]) - ce, float(p_n[2]) - cd
        x, y, z = (sum(rows[i][k] * away[i] for i in range(3)) for k in range(3))
        half_x, half_y, half_z = (0.5 * size for size in self.size_m)
        if self.shape == "box":
            p_b = _within(x, half_x), _within(y, half_y), _within(z, half_z)
        elif self.shape == "cylinder":
            p_b = _in_cylinder((x, y, z), half_x, -half_z, half_z)
        else:
            share = min(1.0, half_x / max(math.sqrt(x * x + y * y + z * z), 1e-12))
            p_b = x * share, y * share, z * share
        n, e, d = (sum(r * p for r, p in zip(row, p_b, strict=True)) for row in rows)
        return cn + n, ce + e, cd + d

    def mesh(self) -> tuple[Array, NDArray[np.int_]]:
        """Return the obstacle's surface: vertices [m] [NED] (V, 3), triangles of vertex indices (F, 3)."""
        from arena.obstacle_surface import unit_mesh

        vertices, faces = unit_mesh(self.shape)
        return self._placed(vertices), faces

    def edges(self) -> Array:
        """Return lines that show the shape of the obstacle: both ends of each line [m] [NED] (E, 2, 3)."""
        from arena.obstacle_surface import unit_edges

        return self._placed(unit_edges(self.shape))

    def _placed(self, unit: Array) -> Array:
        """Convert points of a unit shape (-1 to 1) to points of this obstacle [m] [NED] (..., 3)."""
        import numpy as np

        from arena.portable_math import product

        turned = product(0.5 * np.array(self.size_m) * unit, np.array(self.r_nb).T)
        return np.asarray(turned + np.array(self.centre_n))


def obstacles_of(raw: Iterable[Mapping[str, Any]] | None) -> tuple[Obstacle, ...]:
    """Return the obstacles in the JSON configuration (slice) of a process.

    raw: value of the key `obstacles` in this file; None if the file does not have this key.
    """
    return tuple(
        Obstacle(
            name=str(o["name"]),
            shape=o["shape"],
            size_m=_triple(o["size_m"]),
            centre_n=_triple(o["centre_n"]),
            rpy_rad=_triple(o["rpy_rad"]),
            colour=str(o["colour"]),
        )
        for o in raw or ()
    )


def full_size(shape: Shape, size: tuple[float, ...]) -> Triple:
    """Return the extents of a shape along its own axes [m].

    size: as in the YAML, one number for each word in `SIZES`.
    """
    if shape == "box":
        return size[0], size[1], size[2]
    return size[0], size[0], size[-1]


def half_extents(shape: Shape, size_m: Triple, rpy_rad: Triple) -> Triple:
    """Return the half size of a rotated shape's bounding box along north, east and down [m].

    size_m, rpy_rad: as in `Obstacle`.
    """
    x, y, z = (0.5 * size for size in size_m)
    if shape == "sphere":
        return x, y, z
    n, e, d = (
        abs(a) * x + abs(b) * y + abs(c) * z
        if shape == "box"
        else abs(c) * z + math.sqrt(max(0.0, 1.0 - c * c)) * x
        for a, b, c in _rotation(rpy_rad)
    )
    return n, e, d


def gap_to_vehicle_m(obstacle: Obstacle, start_n: Triple, radius_m: float, height_m: float) -> float:
    """Return the distance between an obstacle and an upright vehicle [m]; 0 if they overlap.

    Both bodies are convex, so projections from one to the other in turn converge to their nearest points.

    start_n: lowest point of the vehicle [m] [NED].  radius_m, height_m: of the upright cylinder around the vehicle [m].
    """
    north, east, down = start_n
    other = mine = obstacle.centre_n
    for _ in range(_SWAPS):
        x, y, z = _in_cylinder((other[0] - north, other[1] - east, other[2] - down), radius_m, -height_m, 0.0)
        mine = north + x, east + y, down + z
        other = obstacle.nearest(mine)
    return math.dist(mine, other)


def _rotation(rpy_rad: Triple) -> Rows:
    """Return the rotation matrix from body axes (FRD) to NED for roll, pitch, yaw [rad], as a tuple of rows.

    The angles are intrinsic z-y'-x''.
    """
    (sr, sp, sy), (cr, cp, cy) = map(math.sin, rpy_rad), map(math.cos, rpy_rad)
    return (
        (cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy),
        (cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy),
        (-sp, sr * cp, cr * cp),
    )


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


def _in_cylinder(p: Triple, radius: float, low: float, high: float) -> Triple:
    """Return the point of an upright cylinder that is nearest to a point.

    low, high: ends on the third axis [m].
    """
    share = min(1.0, radius / max(math.hypot(p[0], p[1]), 1e-12))
    return p[0] * share, p[1] * share, min(max(p[2], low), high)


def _triple(raw: Any) -> Triple:
    x, y, z = raw
    return float(x), float(y), float(z)
