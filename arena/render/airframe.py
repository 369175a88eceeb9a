"""3D model of a multirotor: flat faces in body axes, computed from the positions of its rotors. Pure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from arena.geometry import Array

Paint = Literal["body", "canopy", "front", "arm", "motor", "disc", "blade", "leg"]

_DISC_CORNERS, _BODY_CORNERS, _MOTOR_CORNERS = 20, 8, 6
_SHARE_OF_GAP = 0.46  # radius of a propeller disc as a share of the distance to the next rotor


@dataclass(frozen=True, kw_only=True)
class Airframe:
    """Rotor positions and dimensions of a multirotor.

    rotors_b: places of the rotors [m] [FRD] (r, 3).  disc_m: radius of a propeller [m].
    below_m: height of the body origin above the lowest point [m].
    """

    rotors_b: Array
    disc_m: float
    below_m: float

    @property
    def radius_m(self) -> float:
        """Largest horizontal distance from the body origin to the edge of a propeller [m]."""
        return float(np.hypot(self.rotors_b[:, 0], self.rotors_b[:, 1]).max()) + self.disc_m


@dataclass(frozen=True, kw_only=True)
class Mesh:
    """Triangles and polygons that form the 3D model of an airframe.

    points_b: corners of all faces [m] [FRD] (k, 3).  corners: rows of `points_b` of each face.
    normals_b: outward unit vector of each face [FRD] (f, 3).  two_sided: faces that are visible from both sides (f,).
    units: 0 for faces of the body, 1 + i for those of arm i (f,).  levels: order of the faces within a unit, from the lowest
    to the highest (f,).  paints: what each face belongs to.  places_b: centre of each unit [m] [FRD] (u, 3).
    centres_b: centre of each face [m] [FRD] (f, 3).
    """

    points_b: Array
    corners: tuple[NDArray[np.intp], ...]
    normals_b: Array
    two_sided: NDArray[np.bool_]
    units: NDArray[np.intp]
    levels: NDArray[np.intp]
    paints: tuple[Paint, ...]
    places_b: Array
    centres_b: Array


def airframe(
    rotors_b: Sequence[Sequence[float]], *, disc_m: float | None = None, below_m: float = 0.06
) -> Airframe:
    """Return the dimensions of a multirotor whose rotor positions are given.

    rotors_b: places of the rotors [m] [FRD].
    disc_m: radius of a propeller [m]; None: made from the gaps.
    below_m: height of the body origin above the lowest point [m].
    """
    places = np.asarray(rotors_b, float).reshape(-1, 3)
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=2)
    apart = apart[apart > 0.02]  # coaxial rotors have the same place, seen from above
    gap = float(apart.min()) if apart.size else 2.0 * float(np.hypot(places[:, 0], places[:, 1]).max() or 0.2)
    largest = _SHARE_OF_GAP * gap
    return Airframe(rotors_b=places, disc_m=min(disc_m or largest, 1.05 * largest), below_m=below_m)


def default_airframe() -> Airframe:
    """Return a quadrotor in X configuration, for logs without rotor positions."""
    return airframe([(x, y, -0.02) for x, y in ((0.16, 0.16), (-0.16, -0.16), (0.16, -0.16), (-0.16, 0.16))])


class _Builder:
    def __init__(self) -> None:
        self.points: list[Array] = []
        self.corners: list[NDArray[np.intp]] = []
        self.normals: list[Array] = []
        self.rest: list[tuple[bool, int, int, Paint]] = []

    def face(self, points: Array, outward: Array, unit: int, level: int, paint: Paint) -> None:
        """Add one flat face to the 3D model.

        outward: a vector to the outside (3,); zeros: visible from both sides.
        """
        first = sum(map(len, self.points))
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        normal /= np.linalg.norm(normal)
        self.points.append(points)
        self.corners.append(np.arange(first, first + len(points)))
        self.normals.append(-normal if normal @ outward < 0.0 else normal)
        self.rest.append((not outward.any(), unit, level, paint))

    def prism(
        self, low: Array, high: Array, unit: int, level: int, paint: Paint, *, bottom: bool = True
    ) -> None:
        """Add a prism between two rings of corners to the 3D model. Each ring is [m] [FRD] (n, 3).

        bottom: with the ring `low` as a face.
        """
        middle = 0.5 * (low.mean(axis=0) + high.mean(axis=0))
        for i in range(len(low)):
            j = (i + 1) % len(low)
            side = np.stack([low[i], low[j], high[j], high[i]])
            self.face(side, side.mean(axis=0) - middle, unit, level, paint)
        self.face(high, high.mean(axis=0) - middle, unit, level, paint)
        if bottom:
            self.face(low, low.mean(axis=0) - middle, unit, level, paint)

    def bar(self, start: Array, end: Array, half_m: float, unit: int, level: int, paint: Paint) -> None:
        """Add a bar with a square cross-section between two points [m] [FRD] (3,).

        half_m: half its thickness [m].
        """
        along = (end - start) / np.linalg.norm(end - start)
        other = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        side = np.cross(along, other)
        side /= np.linalg.norm(side)
        up = np.cross(along, side)
        ring = half_m * np.stack([side + up, side - up, -side - up, -side + up])
        self.prism(start + ring, end + ring, unit, level, paint, bottom=False)


def _ring(place: Array, radius: float, corners: int, turn: float = 0.0) -> Array:
    angle = 2.0 * np.pi * (np.arange(corners) + turn) / corners
    return place + radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(corners)], axis=1)


def mesh(frame: Airframe) -> Mesh:
    """Return the 3D model of an airframe: body, canopy, legs, and an arm, a motor and a disc per rotor."""
    made, none = _Builder(), np.zeros(3)
    reach = float(np.hypot(frame.rotors_b[:, 0], frame.rotors_b[:, 1]).max())
    top = float(frame.rotors_b[:, 2].min())  # rotors above the body have a negative z
    body, thick = 0.34 * reach, 0.10 * reach
    deck = np.array([0.0, 0.0, -0.6 * thick])
    for x, y in ((0.8, 0.8), (0.8, -0.8), (-0.8, 0.8), (-0.8, -0.8)):
        foot = np.array([x * body, y * body * 1.15, frame.below_m])
        made.bar(np.array([x * body * 0.7, y * body * 0.7, 0.0]), foot, 0.018 * reach, 0, 0, "leg")
    made.prism(
        _ring(-deck, body, _BODY_CORNERS, 0.5),
        _ring(deck, body, _BODY_CORNERS, 0.5),
        0,
        1,
        "body",
    )
    roof = min(-thick * 1.4, top - 0.02 * reach)
    made.prism(
        _ring(deck, body * 0.86, _BODY_CORNERS, 0.5),
        _ring(np.array([-0.04 * reach, 0.0, roof]), body * 0.42, _BODY_CORNERS, 0.5),
        0,
        2,
        "canopy",
        bottom=False,
    )
    for i, place in enumerate(frame.rotors_b, start=1):
        root = np.array([*(place[:2] * 0.2), 0.0])
        end = np.array([*place[:2], place[2] + 0.05 * reach])
        made.bar(root, end, 0.035 * reach, i, 0, "front" if place[0] > 0.02 else "arm")
        up = np.array([0.0, 0.0, -reach])
        low, high = place - 0.09 * up, place + 0.03 * up
        made.prism(
            _ring(low, 0.075 * reach, _MOTOR_CORNERS),
            _ring(high, 0.075 * reach, _MOTOR_CORNERS),
            i,
            1,
            "motor",
            bottom=False,
        )
        above = place + 0.06 * up
        made.face(_ring(above, frame.disc_m, _DISC_CORNERS), none, i, 2, "disc")
        width = 0.11 * frame.disc_m
        tip = frame.disc_m * 0.97
        blade = np.array(
            [(tip, -width / 2, 0), (tip, width / 2, 0), (-tip, width / 2, 0), (-tip, -width / 2, 0)]
        )
        made.face(above + blade, none, i, 3, "blade")
    two_sided, units, levels, paints = zip(*made.rest, strict=True)
    places = np.concatenate([np.zeros((1, 3)), frame.rotors_b])
    return Mesh(
        points_b=np.concatenate(made.points),
        corners=tuple(made.corners),
        normals_b=np.stack(made.normals),
        two_sided=np.array(two_sided, bool),
        units=np.array(units, np.intp),
        levels=np.array(levels, np.intp),
        paints=paints,
        places_b=places,
        centres_b=np.stack([points.mean(axis=0) for points in made.points]),
    )
