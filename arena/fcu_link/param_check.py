"""The parameters that must hold before arming: read one by one, compared, told. It writes none on the vehicle. Pure.

PX4 answers a name that it does not know with silence. A silence is taken for that only while other parameters are answered: one
that is known is asked in between, as a probe of the wire.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from arena.wire.mavlink_params import DOES_NOT_EXIST, Value

WINDOW = 8  # asked for and not answered yet
RETRY_S = 0.4
TRIES = 5
AGAIN_S = 5.0  # the wrong ones are read again, for somebody may be setting them
_RELATIVE = 1e-5
_ABSOLUTE = 1e-9
_SHOWN = 3


@dataclass(kw_only=True)
class _Param:
    """wanted: must hold.  value: read.  asked: when.  tries: since it was read.  proofs: answers seen when first asked."""

    wanted: float
    value: float | None = None
    kind: int = 0
    asked: float = -math.inf
    tries: int = 0
    unknown: bool = False
    due: bool = True
    proofs: int = 0

    @property
    def holds(self) -> bool:
        if self.value is None:
            return False
        return math.isclose(self.value, self.wanted, rel_tol=_RELATIVE, abs_tol=_ABSOLUTE)


class ParamCheck:
    """shown: how the file of them is called where people look for it."""

    def __init__(self, params: Mapping[str, float], shown: str) -> None:
        self._params = {name: _Param(wanted=value) for name, value in params.items()}
        self._shown = shown
        self._answers = 0
        self._next_round = math.inf
        self._told = ""
        self.events: list[str] = []

    @property
    def complete(self) -> bool:
        """Each has been read, or is known not to exist."""
        return not any(p.value is None and not p.unknown for p in self._params.values())

    @property
    def types(self) -> dict[str, int]:
        """MAV_PARAM_TYPE of those that were read."""
        return {name: p.kind for name, p in self._params.items() if p.kind}

    def restart(self) -> None:
        """The vehicle has started anew: what it holds must be read again."""
        for p in self._params.values():
            p.value, p.unknown, p.due, p.tries, p.asked = None, False, True, 0, -math.inf
        self._told = ""

    def due(self, now: float) -> list[str]:
        """Names to ask for now. To be asked only while the vehicle is heard."""
        if self.complete and now >= self._next_round:
            self._again(now)
        waiting = [p for p in self._params.values() if p.due and now - p.asked < RETRY_S]
        free = WINDOW - len(waiting)
        found: list[str] = []
        for name, p in self._params.items():
            if len(found) >= free:
                break
            if p.due and now - p.asked >= RETRY_S and not self._give_up(p):
                found += [*([] if p.tries < 2 else self._probe(name)), name]
                p.proofs = self._answers if p.tries == 0 else p.proofs
                p.asked, p.tries = now, p.tries + 1
        self._tell(now)
        return list(dict.fromkeys(found))

    def hear(self, said: Value) -> None:
        """A PARAM_VALUE of the autopilot, whoever asked for it."""
        p = self._params.get(said.name)
        if p is not None:
            self._answers += 1
            p.value, p.kind, p.unknown, p.due, p.tries = said.value, said.kind, False, False, 0

    def refuse(self, name: str, error: int) -> None:
        """A PARAM_ERROR: newer autopilots say what older ones are silent about."""
        p = self._params.get(name)
        if p is not None and error == DOES_NOT_EXIST:
            self._answers += 1
            p.unknown, p.due, p.value = True, False, None

    def reasons(self) -> list[str]:
        """Without "Preflight: "; the first three, and how many more."""
        found = list(self._differences())
        unread = sum(p.value is None and not p.unknown for p in self._params.values())
        if unread:
            found.append(f"{unread} of {len(self._params)} parameters not read yet")
        if len(found) <= _SHOWN:
            return found
        return [*found[:_SHOWN], f"... and {len(found) - _SHOWN} more, see {self._shown}"]

    def _differences(self) -> Iterator[str]:
        for name, p in self._params.items():
            if p.unknown:
                yield f"{name} is unknown to the vehicle"
            elif p.value is not None and not p.holds:
                yield f"{name} is {p.value:.6g}, needs {p.wanted:.6g}"

    def _give_up(self, p: _Param) -> bool:
        """Asked often enough while others were answered: there is none of that name."""
        if p.tries >= TRIES and self._answers - p.proofs >= 2:
            p.unknown, p.due = True, False
            return True
        return False

    def _probe(self, name: str) -> list[str]:
        return next(([n] for n, p in self._params.items() if p.value is not None and n != name), [])

    def _again(self, now: float) -> None:
        self._next_round = now + AGAIN_S
        for p in self._params.values():
            if p.unknown or not p.holds:
                p.due, p.tries, p.asked = True, 0, -math.inf

    def _tell(self, now: float) -> None:
        """When all have been read, and when what is wrong changes."""
        if not self.complete:
            return
        if self._next_round == math.inf:
            self._next_round = now + AGAIN_S
        wrong = list(self._differences())
        all_ = len(self._params)
        words = (
            f"{len(wrong)} of {all_} parameters do not hold: {'; '.join(wrong)}"
            if wrong
            else f"all {all_} parameters hold"
        )
        if self._params and words != self._told:
            self._told = words
            self.events.append(
                words
                if not wrong
                else f"{words}. Load {self._shown} in QGroundControl, then reboot the vehicle"
            )
