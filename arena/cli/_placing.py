"""Checks of `arena up` before the start: whether the address is free, and whether a running arena or replay is in the way."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from arena.cli._arena import at_free_address
from arena.errors import RunError
from arena.supervisor import active_runs, plan_of

if TYPE_CHECKING:
    from arena.plan.model import Plan
    from arena.schema import Arena


def place(arena: Arena, plan: Plan, overrides: list[str], say: Callable[[str], None]) -> Plan:
    """Check this computer, and return the plan. If its default address is in use, the returned plan has a free address.

    An address that the user has set never changes.

    say: prints which address was chosen, and why.
    Raises InputError for problems of this computer, RunError if another arena uses the same address or ports.
    """
    from arena.plan.machine import check_machine

    arena, plan, moved = at_free_address(arena, plan, overrides)
    if moved:
        say(moved)
    refuse_beside(plan)
    check_machine(arena, plan)
    return plan


def refuse_beside(plan: Plan) -> None:
    """Raise RunError if this plan must not run beside an arena or a replay that is running."""
    refuse_second(plan)
    _refuse_beside_replay(plan)


def refuse_second(plan: Plan) -> None:
    """Raise RunError if a running arena uses the same address or the same ports as this plan."""
    for state in active_runs():
        other = plan_of(state)
        shared = _sockets(plan) & _sockets(other) if other else set()
        if state.live and (state.address == plan.address or shared):
            another = "set another `address` for the new arena, for example 127.0.0.2"
            if state.address != plan.address:  # the shared ports are bound on every address
                ports = ", ".join(str(port) for port in sorted({port for _, _, port in shared})[:3])
                another = (
                    f"set other vehicle ids in the new arena, because PX4 binds its ports ({ports}, ...) "
                    "on every address of the computer"
                )
            raise RunError(
                f"the arena {state.name!r} is running on {state.address} (supervisor {state.supervisor.pid}, {state.run}). "
                f"End it with `arena down --run {state.run}`, or {another}"
            )


def _refuse_beside_replay(plan: Plan) -> None:
    """Raise RunError if a ground station would receive real and replayed vehicles at the same time.

    The plan has real vehicles, and a replay is running. The ground station would mix up real and replayed
    vehicles with the same id, and show the state of the wrong one.
    """
    if all(v.simulated for v in plan.vehicles):
        return
    for state in active_runs():
        other = plan_of(state)
        if state.live and other is not None and other.is_replay and other.slices["router.json"]["gcs"]:
            raise RunError(
                f"a replay is running ({state.run}) and sends the telemetry of recorded vehicles to ground stations. A ground station "
                f"would confuse recorded vehicles with real ones. End it with `arena down --run {state.run}`, or replay with --no-gcs"
            )


def _sockets(plan: Plan) -> set[tuple[str, str, int]]:
    return {(x.protocol, x.address, x.port) for spec in plan.processes for x in spec.listens}
