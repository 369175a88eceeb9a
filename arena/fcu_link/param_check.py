"""Check that a vehicle has the required parameter values.

The parameters are read one by one, and none is changed. Pure.

PX4 does not reply to a request for an unknown name. Therefore a name counts as unknown only if other
parameters are answered at the same time. To test this, a parameter that is known to exist is requested in
between.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from pymavlink.dialects.v20.common import MAV_CMD_PREFLIGHT_STORAGE, MAV_PARAM_TYPE_INT32

from arena.wire.mavlink_params import DOES_NOT_EXIST, Value

MAX_PENDING = 8  # requests without an answer yet
RETRY_S = 0.4
TRIES = 5
RECHECK_S = 5.0  # wrong values are read again: somebody may be setting them
ROTATION_S = 30.0  # right values are read again in this time, in groups: somebody may have reset them
MAX_GROUP = 25  # right values in a group, so that a slow serial line is not flooded
_RELATIVE = 1e-5  # floats only: integers are compared exactly
_ABSOLUTE = 1e-9
_MAX_SHOWN = 3
_SURELY_MISSING = 2  # rounds of requests without a reply
_BREAKER = "CBRK_"  # a circuit breaker that the vehicle does not have is not on


@dataclass(kw_only=True)
class _Param:
    """Required parameter: its required value, and what the vehicle has replied so far.

    wanted: required value; None: the value is only read
    value: value read from the vehicle; None before the first reply
    kind: MAV_PARAM_TYPE; 0 before the first reply
    asked: time of the last request [s]
    tries: number of requests since the last reply, or since the parameter became due
    unknown: the vehicle does not have this parameter
    due: the parameter must be read
    missed: number of times that the vehicle was found not to have it, since the last reply
    answers_before: number of replies to all requests at the time of the first request for this parameter
    """

    wanted: float | None = None
    value: float | None = None
    kind: int = 0
    asked: float = -math.inf
    tries: int = 0
    unknown: bool = False
    due: bool = True
    missed: int = 0
    answers_before: int = 0

    def make_due(self) -> None:
        """Read the parameter again. Its known value stays valid until a reply arrives."""
        self.due, self.tries, self.asked = True, 0, -math.inf

    @property
    def holds(self) -> bool:
        if self.value is None or self.wanted is None:
            return self.value is not None
        if self.kind == MAV_PARAM_TYPE_INT32:
            return self.value == self.wanted
        return math.isclose(self.value, self.wanted, rel_tol=_RELATIVE, abs_tol=_ABSOLUTE)


class ParamCheck:
    """Reads the required parameters from the vehicle and compares them with their required values.

    params: name -> required value
    read: names of parameters whose values other preflight checks use; they are read again every 5 s
    display_path: path of the .params file as shown to the user
    events: messages for the user; the caller takes them and empties the list
    """

    def __init__(self, params: Mapping[str, float], display_path: str, read: Sequence[str] = ()) -> None:
        self._params = {name: _Param(wanted=value) for name, value in params.items()}
        self._read = frozenset(read)
        self._params |= {name: _Param() for name in read if name not in params}
        self._display_path = display_path
        self._answers = 0
        self._next_recheck = math.inf
        self._next_group = 0  # index of the first parameter of the next group in the rotation
        self._all_at_recheck = self._reads_all = False
        self._last_event = ""
        self.events: list[str] = []

    @property
    def complete(self) -> bool:
        """True if every parameter has been read, or does not exist on the vehicle."""
        return not any(p.value is None and not p.unknown for p in self._params.values())

    @property
    def types(self) -> dict[str, int]:
        """Return parameter name -> MAV_PARAM_TYPE, for the parameters that have been read."""
        return {name: p.kind for name, p in self._params.items() if p.kind}

    def values(self) -> dict[str, float | None]:
        """Return {name: value} of the parameters that other preflight checks need, such as the RC check.

        None: not read yet. NaN: the vehicle does not have the parameter.
        """
        return {name: math.nan if (p := self._params[name]).unknown else p.value for name in self._read}

    def restart(self) -> None:
        """Read all parameters again after a reboot of the vehicle."""
        for p in self._params.values():
            p.value, p.unknown = None, False
            p.make_due()
        self._last_event = ""

    def on_command(self, command: int, now: float) -> None:
        """Process a command to the vehicle from another sender: PREFLIGHT_STORAGE can change all parameters.

        command: MAV_CMD; 0 for a message that is not a command
        """
        if command == MAV_CMD_PREFLIGHT_STORAGE:
            self.read_again(now)

    def read_again(self, now: float) -> None:
        """Read all parameters again now, and once more 5 s later, because PX4 needs some time for the command.

        The known values stay valid until the replies arrive.
        """
        for p in self._params.values():
            p.make_due()
        self._all_at_recheck = self._reads_all = True
        if self._next_recheck < math.inf:
            self._next_recheck = now + RECHECK_S

    def due(self, now: float) -> list[str]:
        """Return the names of the parameters to request now.

        Call this method only while the vehicle is connected.
        """
        if self.complete and now >= self._next_recheck:
            self._recheck(now)
        if self._reads_all and not self._all_at_recheck and not any(p.due for p in self._params.values()):
            self._reads_all = False
        waiting = [p for p in self._params.values() if p.due and now - p.asked < RETRY_S]
        free = MAX_PENDING - len(waiting)
        found: list[str] = []
        for name, p in self._params.items():
            if len(found) >= free:
                break
            if p.due and now - p.asked >= RETRY_S and not self._give_up(p):
                found += [*([] if p.tries < 2 or p.value is not None else self._probe(name)), name]
                p.answers_before = self._answers if p.tries == 0 else p.answers_before
                p.asked, p.tries = now, p.tries + 1
        self._report(now)
        return list(dict.fromkeys(found))

    def on_value(self, received: Value) -> None:
        """Process a PARAM_VALUE of the autopilot, whoever has requested it."""
        p = self._params.get(received.name)
        if p is not None:
            self._answers += 1
            p.value, p.kind, p.unknown, p.due, p.tries = received.value, received.kind, False, False, 0
            p.missed = 0

    def on_error(self, name: str, error: int) -> None:
        """Mark a parameter as missing in the vehicle if a PARAM_ERROR reports that it does not exist.

        Only newer autopilots send this message.
        """
        p = self._params.get(name)
        if p is not None and error == DOES_NOT_EXIST:
            self._answers += 1
            p.unknown, p.due, p.value, p.missed = True, False, None, _SURELY_MISSING

    def reasons(self) -> list[str]:
        """Return why wrong or unread parameters forbid arming: at most three reasons, and how many more there are."""
        found = list(self._differences())
        unread = sum(p.value is None and not p.unknown for p in self._params.values())
        if self._reads_all:
            found.append("parameters are being read again")
        if unread:
            found.append(f"{unread} of {len(self._params)} parameters not read yet")
        if len(found) <= _MAX_SHOWN:
            return found
        return [*found[:_MAX_SHOWN], f"... and {len(found) - _MAX_SHOWN} more, see {self._display_path}"]

    def _differences(self) -> Iterator[str]:
        for name, p in self._params.items():
            if p.unknown and p.wanted is not None and not self._is_off(name, p):
                yield f"{name} is unknown to the vehicle"
            elif p.value is not None and p.wanted is not None and not p.holds:
                yield f"{name} is {_text(p.value, p.kind)}, needs {_text(p.wanted, p.kind)}"

    def _is_off(self, name: str, p: _Param) -> bool:
        """Return whether a circuit breaker is off because the vehicle does not have its parameter.

        Replies can be lost, so it counts as missing only after `_SURELY_MISSING` rounds of requests without a reply.
        """
        return p.wanted == 0 and name.startswith(_BREAKER) and p.missed >= _SURELY_MISSING

    def _give_up(self, p: _Param) -> bool:
        """Stop requesting a parameter after several requests without a reply. Return whether it was stopped.

        A parameter with a known value keeps the value until it is read again. Another parameter is marked as unknown, but only
        if the vehicle replied to other requests meanwhile.
        """
        if p.tries < TRIES:
            return False
        if p.value is not None:
            p.due = False
        elif self._answers - p.answers_before >= 2:
            p.unknown, p.due, p.missed = True, False, p.missed + 1
        return not p.due

    def _probe(self, name: str) -> list[str]:
        return next(([n] for n, p in self._params.items() if p.value is not None and n != name), [])

    def _recheck(self, now: float) -> None:
        """Read again: wrong and unknown parameters, those of other checks, and the next group of all parameters."""
        self._next_recheck = now + RECHECK_S
        group = set(self._params) if self._all_at_recheck else self._group()
        self._all_at_recheck = False
        for name, p in self._params.items():
            if p.unknown or not p.holds or name in self._read or name in group:
                p.make_due()

    def _group(self) -> set[str]:
        """Return the names of the next group in the rotation through all parameters."""
        names = list(self._params)
        size = min(math.ceil(len(names) * RECHECK_S / ROTATION_S), MAX_GROUP)
        found = {names[(self._next_group + i) % len(names)] for i in range(size)}
        self._next_group += size
        return found

    def _report(self, now: float) -> None:
        """Report to the user whether all parameters have their required values.

        Do nothing until all parameters have been read. Add another event whenever the list of parameters with wrong values changes.
        """
        if not self.complete:
            return
        if self._next_recheck == math.inf:
            self._next_recheck = now + RECHECK_S
        wrong = list(self._differences())
        all_ = sum(p.wanted is not None for p in self._params.values())
        words = (
            f"{len(wrong)} of {all_} parameters differ: {'; '.join(wrong)}"
            if wrong
            else f"all {all_} parameters are as required"
        )
        if all_ and words != self._last_event:
            self._last_event = words
            self.events.append(
                words
                if not wrong
                else f"{words}. Load {self._display_path} in QGroundControl, then reboot the vehicle"
            )


def _text(value: float, kind: int) -> str:
    """Return a parameter value as text; integers with all digits. kind: MAV_PARAM_TYPE."""
    return f"{value:.0f}" if kind == MAV_PARAM_TYPE_INT32 and value == round(value) else f"{value:.6g}"
