"""Thrust curves of the vehicle profiles: static thrust as a function of the motor command.

Pure. The world, the built-in autopilot and user programs use them. The planning packages use only `static_command`
of quadratic curves. It needs no numpy, whose import takes longer than everything that `arena check` does with an arena.

Every curve is for the vehicle's TOTAL thrust; one of n equal rotors gives a share of 1/n. The command u is
0..1. Both directions are limited to what the vehicle can do, so the argument of a tangent stays within one
branch. At rest they are exact inverses of each other:

    newtons(command(T)) = T   for 0 <= T <= max_newtons          command(newtons(u)) = u   for 0 <= u <= 1

At airspeed v the rotors give the share `1 - v / fade_speed_m_s` of this thrust, if the profile has that
value.

The two published formulas for the iris differ slightly. The curve is T = 34.068 u^2 + 7.1202 u. The other
formula is its tangent near hover, u = (T - 14.906) / 45.34 + 0.561; it differs in u by 0.7 % at hover, 0.14
at full thrust and 0.23 at zero thrust. `newtons` is the first formula and `command` its inverse. The share
that is lost at speed comes from the second.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from arena.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

_MIN_SHARE = 0.1  # of the static thrust that remains at any airspeed: prevents a division by zero


@dataclass(frozen=True, kw_only=True)
class ThrustCurve:
    """Total thrust of a vehicle as a function of the motor command, and the inverse function.

    max_newtons: total static thrust at u = 1 [N]
    fade_speed_m_s: airspeed at which the rotors would give no thrust [m/s]
    """

    max_newtons: float
    fade_speed_m_s: float = math.inf
    _newtons: Callable[[Array], Array] = field(repr=False)
    _command: Callable[[Any], Any] = field(repr=False)

    def newtons(self, u: ArrayLike, speed_m_s: ArrayLike = 0.0) -> Array:
        """Return the total thrust [N] for a motor command 0..1.

        Both arguments can be arrays whose shapes numpy can broadcast.

        u: command, limited to 0..1 [-]
        speed_m_s: airspeed [m/s]
        """
        import numpy as np

        return self._newtons(np.clip(np.asarray(u, dtype=np.float64), 0.0, 1.0)) * self._share(speed_m_s)

    def command(self, newtons: ArrayLike, speed_m_s: ArrayLike = 0.0) -> Array:
        """Return the motor command 0..1 [-] for a total thrust [N].

        For a thrust that the rotors cannot give, return the command of the nearest possible thrust.

        newtons: total thrust [N]
        speed_m_s: airspeed [m/s]
        """
        import numpy as np

        static = np.asarray(newtons, dtype=np.float64) / self._share(speed_m_s)
        found: Array = np.clip(self._command(np.clip(static, 0.0, self.max_newtons)), 0.0, 1.0)
        return found

    def static_command(self, newtons: float) -> float:
        """Return the motor command 0..1 [-] for a total thrust at airspeed 0.

        newtons: [N]. This method is for one value and needs no numpy.
        """
        return min(max(float(self._command(min(max(newtons, 0.0), self.max_newtons))), 0.0), 1.0)

    def _share(self, speed_m_s: ArrayLike) -> Array:
        import numpy as np

        return np.clip(
            1.0 - np.abs(np.asarray(speed_m_s, dtype=np.float64)) / self.fade_speed_m_s, _MIN_SHARE, 1.0
        )


def thrust_curve(settings: Mapping[str, Any]) -> ThrustCurve:
    """Return the thrust curve that a vehicle profile describes under `thrust_curve`.

    Raises InputError if its kind does not exist.
    """
    maker = _KINDS.get(settings.get("kind", ""))
    if maker is None:
        raise InputError(
            f"thrust_curve.kind: got {settings.get('kind')!r}, expected one of {', '.join(sorted(_KINDS))}"
        )
    return maker(settings)


def _quadratic(s: Mapping[str, Any]) -> ThrustCurve:
    """Return the thrust curve T = a u^2 + b u, with thrust T [N] and motor command u 0..1 [-].

    a, b [N], a > 0, b >= 0.
    """
    a, b = float(s["a"]), float(s["b"])
    return ThrustCurve(
        max_newtons=a + b,
        fade_speed_m_s=_fade(s),
        _newtons=lambda u: (a * u + b) * u,
        # the root written so that nothing cancels near T = 0
        _command=lambda t: 2.0 * t / (b + _sqrt(b * b + 4.0 * a * t) + 1e-300),
    )


def _sqrt(value: Any) -> Any:
    """Return the square root of a float or of an array."""
    if isinstance(value, float):
        return math.sqrt(value)
    import numpy as np

    return np.sqrt(value)


def _tangent(s: Mapping[str, Any]) -> ThrustCurve:
    """Return the thrust curve u = (tan((T - offset) / scale) + phase) / gain, with thrust T and motor command u.

    offset, scale [N]; phase, gain [-].

    Below the command `low_u` the fit is not valid, because it gives thrust at u = 0. A straight line from the
    origin replaces it there.
    """
    import numpy as np

    from arena.portable_math import arctan, tan

    offset, scale, phase, gain, low = (float(s[k]) for k in ("offset_n", "scale_n", "phase", "gain", "low_u"))

    def fitted(u: Array) -> Array:
        found: Array = offset + scale * arctan(gain * u - phase)
        return found

    knee = float(fitted(np.asarray(low)))
    top = float(fitted(np.asarray(1.0)))

    def command(t: Array) -> Array:
        return np.where(
            t < knee,
            t * low / knee,
            (tan((np.maximum(t, knee) - offset) / scale) + phase) / gain,
        )

    return ThrustCurve(
        max_newtons=top,
        fade_speed_m_s=_fade(s),
        _newtons=lambda u: np.where(u < low, u * knee / low, fitted(np.maximum(u, low))),
        _command=command,
    )


def _fade(s: Mapping[str, Any]) -> float:
    fade = s.get("fade_speed_m_s")
    return math.inf if fade is None else float(fade)


_KINDS: dict[str, Callable[[Mapping[str, Any]], ThrustCurve]] = {"quadratic": _quadratic, "tangent": _tangent}
