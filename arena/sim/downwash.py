"""Downwash: wind that the rotors of a vehicle cause at the vehicles below it. Pure, batched over vehicles.

Source: Bauersfeld, Koen Muller, Ziegler, Coletti and Scaramuzza, "Robotics meets fluid dynamics: a
characterization of the induced airflow below a quadrotor as a turbulent jet", IEEE Robotics and Automation
Letters, 2025 (measured below six quadrotors of different sizes). The air below a multirotor is a turbulent
jet. At the distance s along the axis of the jet and r from the axis, in the length l between opposite motors:

    U(s, r) = U_c / (1 + (sqrt(2) - 1) (r / r_half)^2)^2
    U_c = 10.11 U_h / (s / l + 5.817)          speed on the axis
    r_half = 0.07668 (s + 5.817 l)             distance at which U is half of U_c
    U_h = sqrt(T / (2 rho A))                  induced speed of the rotors at the thrust T (momentum theory)

A: area of all rotor discs. The axis points along the body's z axis.

The paper's jet is valid from 2.5 l on. It is used nearer to the vehicle, too, where the single jets of the
rotors have not merged. There it keeps the momentum of the flow but not its shape. Over the first rotor radius
the speed grows from zero, so that vehicles at the same height do not cross a jump. The profile ends at six
r_half (0.4 %), and this value is subtracted everywhere.

A vehicle below feels the wind through its own drag and the loss of its thrust with airspeed. Its rotors, not
its centre, are in the wind, so r is lengthened to sqrt(r^2 + c^2), c: distance of its rotors from its centre.

Not modelled: the delay of the wind, its turbulence, its unequal effect on the rotors of one vehicle, the floor.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from arena.kernels.arrays import array, view
from arena.kernels.downwash_wind import DownwashWind

Array = NDArray[np.float64]

AIR_DENSITY_KG_M3 = 1.225
"""Density of the standard atmosphere at sea level (ISO 2533)."""


class Downwash:
    """Model of the wind that V vehicles cause at each other by their downwash.

    profiles: profiles of the vehicles; one without `downwash` makes no wind
    strength: factor of every air speed [-]
    """

    def __init__(self, profiles: Sequence[Mapping[str, Any]], *, strength: float) -> None:
        places = [np.array([r["position_m"] for r in p["rotors"]], float)[:, :2] for p in profiles]
        jets = [p.get("downwash") or {"rotor_radius_m": math.inf} for p in profiles]
        radius: Array = np.array([jet["rotor_radius_m"] for jet in jets], float)
        area = np.pi * radius**2 * [len(each) for each in places]
        factor = strength * np.array([jet.get("strength", 1.0) for jet in jets], float)
        per_root = factor / np.sqrt(2.0 * AIR_DENSITY_KG_M3 * area)
        lengths: Array = np.array([_widest(each) for each in places])
        rotors_out2: Array = np.array([(each**2).sum(1).mean() for each in places])
        self._law = DownwashWind(view(per_root), view(lengths), view(radius), view(rotors_out2))
        self._wind_n = array(self._law.wind_n)
        self.acts = len(profiles) > 1 and bool(per_root.any())

    def wind(self, p_n: Array, r_nb: Array, thrust: Callable[[], Array]) -> Array:
        """Return the wind at each vehicle from the rotors of the other vehicles [m/s] [NED] (V, 3).

        p_n: position of the body origins [m] [NED] (V, 3)
        r_nb: rotation matrix of the attitude (V, 3, 3)
        thrust: function that returns the thrust of each vehicle [N] (V,). It is called only if a jet reaches a vehicle
        """
        at, axes = view(p_n), view(r_nb)
        if not self._law.reaches(at, axes):
            return np.zeros_like(p_n)
        self._law.compute(at, axes, view(thrust()))
        return self._wind_n.copy()


def _widest(places: Array) -> float:
    """Return the largest distance between two rotors of a vehicle [m].

    places: positions of the rotors [m] (R, 2)
    """
    return float(np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1)).max())
