"""Reports of the router to the supervisor.

The router process uses this module, and also the process `fused`, which contains all parts of a simulated arena.
"""

from __future__ import annotations

from arena.mavlink_router.router import Router
from arena.process_context import ProcessContext

READY_TIMEOUT_S = 10.0  # a vehicle without a heartbeat for this time is no longer waited for


def report_changes(process: ProcessContext, router: Router) -> None:
    """Report to the supervisor the warnings, facts (such as `armed`) and events that are new since the last call."""
    if not (router.may_have_news or router.commands.has_news):
        return
    router.may_have_news = False
    for warning in router.warnings():  # first, so that a failsafe is shown before the mode that it enters
        process.event(warning)
    events, control = router.commands.changes()
    if changed := {**router.changed_facts(), **control}:
        process.facts(changed)
    for event in events:
        process.event(event)


def report_ready(process: ProcessContext, router: Router, waited_s: float) -> bool:
    """Report to the supervisor that the router is ready, if it is. Return whether it is ready.

    The router is ready if all simulated vehicles are connected, or after `READY_TIMEOUT_S`.

    waited_s: time since the start [s]
    """
    if not router.all_connected and waited_s <= READY_TIMEOUT_S:
        return False
    if missing := router.missing:
        process.event(
            f"{', '.join(missing)}: no heartbeat for {READY_TIMEOUT_S:g} s; starting the other vehicles"
        )
    process.ready()
    return True
