"""Rules for `arena restart`: which process may be restarted, and when. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from arena.plan.model import ProcessSpec

_IN_FLIGHT = {
    "px4": "the motors stop and the vehicle falls",
    "link": "the vehicle receives no poses and no commands until the restart is complete",
    "mocap": "the poses stop for 1 to 3 s, so the autopilots may lose their position and land without it",
    "forward": "the poses stop for 1 to 3 s, so the autopilot may lose its position and land without it",
    "router": "programs and ground stations are cut off for 1 to 3 s, so setpoints stop and failsafes act",
    "copilot": "nobody checks the rules of the copilot",
}
"""Kind of process -> effect of its restart on flying vehicles that depend on it."""
_PROGRAM_IN_FLIGHT = "the setpoints stop, so the offboard failsafe can act"
_NEVER_ALONE = frozenset({"world", "replay"})  # all other processes use their clock and their shared memory


def restart_refusal(spec: ProcessSpec, flying: Sequence[str], *, runs: bool, flies_real: bool) -> str:
    """Return why `arena restart` of a process needs `--yes` now. Return "" if it does not need it.

    flying: vehicles that may be in the air.  runs: the process runs; else a restart interrupts nothing.
    flies_real: it is a user program of an armed real vehicle.

    Raises ValueError for a process that cannot be restarted at all.
    """
    if spec.kind in _NEVER_ALONE:
        raise ValueError(
            f"{spec.name} is not restarted, because all other processes use its clock. "
            "Run `arena down`, then start the arena again"
        )
    effect = _PROGRAM_IN_FLIGHT if flies_real else _IN_FLIGHT.get(spec.kind)
    served = [name for name in flying if (name in spec.flies if flies_real else spec.vehicle in (None, name))]
    if not runs or not served or effect is None:
        return ""
    return (
        f"{spec.name} is not restarted: {', '.join(served)} may be flying. During a restart {effect}. "
        f"Land first (`arena land-all`), or restart in flight with --yes"
    )
