"""Check by hardware uid that the right vehicle answers. Pure.

Two vehicles may have the same MAVLink system id. Nothing is read from or written to a vehicle before its uid is checked.
"""

from __future__ import annotations

from arena.wire.mavlink_minimal import NO_UID, HardwareUid

_REQUEST_S = 0.4
_TRIES = 6


class UidCheck:
    """Check that the autopilot of a vehicle has the expected hardware uid.

    expected: hardware uid in hexadecimal digits; NO_UID; "" for any uid, which is then kept for the whole transfer
    found: uid that the vehicle has sent, or NO_UID; "" before, or if it sends none and any uid is allowed
    passed: the vehicle is the right one
    problem: why the transfer must not go on; "" if there is no reason
    """

    def __init__(self, expected: str) -> None:
        self.expected = expected.lower()
        self.found = ""
        self.passed = False
        self.problem = ""
        self._tries = 0
        self._next = 0.0

    def is_due(self, now: float) -> bool:
        """Return whether the vehicle's uid must be requested now.

        Call this method only while the vehicle is connected. now: monotonic time [s].
        """
        if self.passed or self.problem or now < self._next:
            return False
        self._next = now + _REQUEST_S
        self._tries += 1
        if self._tries <= _TRIES:
            return True
        if self.expected:
            self.problem = f"the vehicle does not report its hardware uid, expected {self.expected}"
        else:
            self.passed = True  # an old autopilot without AUTOPILOT_VERSION
        return False

    def receive(self, uid: HardwareUid) -> None:
        """Compare the uid that the vehicle has sent in AUTOPILOT_VERSION with the expected uid."""
        found, expected = str(uid) or NO_UID, self.expected or self.found
        if expected and found != expected and not uid.matches(expected):
            self.problem = f"another vehicle answers: hardware uid {found}, expected {expected}"
            self.passed = False
            return
        self.found, self.passed = found, True
