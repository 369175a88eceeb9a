"""Address of the live page of `arena up --monitor`, chosen before the start so that its URL can be printed."""

from __future__ import annotations

import dataclasses
import importlib.util
import ipaddress

from arena.constants import MONITOR_PORT
from arena.errors import RunError
from arena.plan.model import Plan, ProcessSpec
from arena.plan.open_ports import MONITOR_COMMAND


def with_page(plan: Plan, *, url: bool) -> tuple[Plan, str]:
    """Return the plan with an address for the live page, and a line for the terminal.

    The line says why there is no page. If there is one, the line contains its URL with `url`, and is "" without.

    Without viser, or without a free port, the plan is returned without the page: a flight does not need it.
    """
    spec = next(
        (p for p in plan.processes if p.name == "tool.monitor" and p.argv[1:4] == MONITOR_COMMAND), None
    )
    if spec is None:
        return plan, ""
    if importlib.util.find_spec("viser") is None:
        why = "the package viser is not installed: pip install 'flying-arena[monitor]'"
        return _without(plan, spec), f"no page: {why}"
    if "--host" in spec.argv or "--port" in spec.argv:
        where = f"watch live: the log of {spec.name} contains the URL (`arena logs {spec.name}`)"
        return plan, where if url else ""
    from arena.monitor.server import free_port

    host = plan.address if ipaddress.ip_address(plan.address).is_loopback else "127.0.0.1"
    try:
        port = free_port(host, MONITOR_PORT)
    except RunError as error:
        return _without(plan, spec), f"no page: {error}"
    placed = dataclasses.replace(spec, argv=(*spec.argv, "--host", host, "--port", str(port)))
    processes = tuple(placed if p is spec else p for p in plan.processes)
    line = f"watch live, when the page has started: http://{host}:{port}/" if url else ""
    return dataclasses.replace(plan, processes=processes), line


def _without(plan: Plan, spec: ProcessSpec) -> Plan:
    return dataclasses.replace(plan, processes=tuple(p for p in plan.processes if p is not spec))
