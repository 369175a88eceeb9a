"""Ground effect: the additional thrust of a hovering multirotor near the floor, as a table over height. Pure.

Method of images (Cheeseman and Bennett, "The effect of the ground on a helicopter rotor in forward flight",
ARC R&M 3021, 1955), with the images of all rotors and the lift from the upward flow (fountain) between the
rotors and under the body: Sanchez-Cuevas, Heredia and Ollero, "Characterization of the aerodynamic ground
effect and its influence in multirotor control", International Journal of Aerospace Engineering, 2017, article 1823056. For a rotor of
radius R whose plane is at height z above the floor:

    T_near / T_far = 1 / (1 - (R / 4z)^2 - S - B)
    S = sum over the other rotors of (R^2 / 2) z / (l^2 + 4z^2)^(3/2)
    B = 2 R^2 K z / (b^2 + 4z^2)^(3/2)

l: distance to another rotor; b: distance between opposite rotors; K: lift of the body, 2 in that paper for
    quadrotors.

The formula was measured for z of half a radius and more. For a smaller z the value at half a radius is used.
The formula is above 1 at any height. Here the effect ends at REACH radii, and its value there (0.2 %) is
subtracted everywhere, so that the thrust has no jump.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

CELLS = 256
REACH = 20.0
"""Height above the floor, of the rotors, from which on there is no ground effect [rotor radii]."""
_MIN_HEIGHT = 0.5  # rotor radii


def ground_table(profile: Mapping[str, Any]) -> tuple[Array, float, float]:
    """Compute a table of how much the floor increases the thrust of a vehicle, over its height.

    profile: the vehicle's profile, as in the files of `profiles/`
    Returns (1) the thrust divided by the thrust far from the floor, at CELLS + 1 equally spaced heights of
    the body origin from 0 [-] (CELLS + 1,); (2) the number of cells per metre [1/m]; (3) the height at which
    the effect ends [m]. Without the key `ground_effect` in the profile these are ones, 0 and 0.
    """
    settings = profile.get("ground_effect")
    if not settings:
        return np.ones(CELLS + 1), 0.0, 0.0
    places = np.array([rotor["position_m"] for rotor in profile["rotors"]], float)
    above, reach = -float(places[:, 2].mean()), REACH * float(settings["rotor_radius_m"])
    height = np.linspace(0.0, reach, CELLS + 1)
    share = ground_share(
        np.minimum(height + above, reach),
        places[:, :2],
        radius=float(settings["rotor_radius_m"]),
        body_lift=float(settings["body_lift"]),
    )
    return 1.0 + (share - share[-1]), CELLS / reach, reach


def ground_share(z: Array, places: Array, *, radius: float, body_lift: float) -> Array:
    """Return the factor by which the floor increases the thrust at each height, averaged over the rotors [-] (n,).

    z: height of the rotors' plane above the floor [m] (n,)
    places: positions of the rotors in that plane [m] (R, 2)
    radius: radius of one rotor [m]
    body_lift: K in the formula [-]
    """
    z = np.maximum(z, _MIN_HEIGHT * radius)
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))  # (R, R)
    others = _image(z, apart[~np.eye(len(places), dtype=bool)].reshape(len(places), -1)).sum(-1)  # (n, R)
    body = 4.0 * body_lift * _image(z, apart.max(keepdims=True))[:, 0, 0]
    lost = (radius / (4.0 * z)) ** 2 + radius**2 * (others.mean(-1) + body)
    return np.asarray(1.0 / (1.0 - lost))


def _image(z: Array, apart: Array) -> Array:
    """Compute the part of the ground effect that another rotor causes [1/m2] (n, ...).

    The model mirrors this rotor at the floor. The result is one term of the sum S in the module's docstring, divided by R^2.

    z: heights of the rotor plane above the floor [m] (n,)
    apart: horizontal distance to the other rotor [m]
    """
    z = z.reshape(-1, *[1] * apart.ndim)
    distance2 = apart**2 + 4.0 * z * z
    return np.asarray(0.5 * z / (distance2 * np.sqrt(distance2)))
