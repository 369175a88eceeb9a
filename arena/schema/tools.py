"""The pydantic models of `tools`: programs that run beside the arena, their readiness probes, and the tools that arena knows by name.

A tool that arena knows is written as `monitor: true`, or as a mapping of its own keys. `known_tools` replaces it by its command.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from arena.schema.base import Address, Port, Strict

MONITOR, ROS2, MICROXRCE, ARENA = "monitor", "ros2", "microxrce", "arena"
MONITOR_ARGV = (ARENA, "monitor", "--run", "{run}")
"""Tool `monitor: true`: the page of `arena monitor`. The plan runs tools with the command `arena` by the arena's interpreter."""
ROS2_MODULE, ROS2_SLICE = "arena.ros2", "ros2.json"
ROS2_ARGV = (ROS2_MODULE, f"{{run}}/slices/{ROS2_SLICE}")
XRCE_COMMAND = "MicroXRCEAgent"
MODULES = frozenset({ARENA, ROS2_MODULE})
"""First words of `argv` that are modules of arena, which arena's Python runs."""

Words = tuple[str, ...]
RestartMode = Literal["never", "on_failure", "always"]
DomainId = Annotated[int, Field(ge=0, le=232)]


def _pattern(text: str) -> str:
    try:
        re.compile(text)
    except re.error as error:
        raise ValueError(f"expected a regular expression: {error}") from error
    return text


class Ready(Strict):
    """How to see that a tool is ready. Set exactly one of log, port, file and delay_s."""

    log: Annotated[str | None, AfterValidator(_pattern)] = None
    """Ready when a line of its output contains a match of this regular expression."""
    port: Annotated[int | None, Field(ge=1, le=65535)] = None
    """Ready when the tool or a process below it listens on this TCP port, or has bound this UDP port."""
    file: str | None = None
    """Ready when this file exists; relative to the folder in which the command runs. It can contain placeholders."""
    delay_s: Annotated[float | None, Field(ge=0, le=600)] = None
    """Ready this time after its start [s]."""
    timeout_s: Annotated[float, Field(gt=0, le=3600)] = 30.0
    """The tool has failed if it is not ready after this time [s]."""


def _one_kind(ready: Ready) -> Ready:
    given = [key for key in ("log", "port", "file", "delay_s") if getattr(ready, key) is not None]
    if len(given) != 1:
        raise ValueError(
            f"got {' and '.join(given) or 'none'}, expected exactly one of log, port, file and delay_s"
        )
    return ready


class Ros2(Strict):
    """The bridge to ROS 2: poses and telemetry as ROS 2 topics, and setpoints from ROS 2. ROS 2 need not be installed."""

    domain: DomainId = 0
    """ROS_DOMAIN_ID."""
    address: Address | None = None
    """Numeric address of the network interface. Default: loopback, so that only nodes on this computer take part."""
    rate_hz: Annotated[float, Field(gt=0, le=200)] = 30.0
    """Most messages per second on each topic of a vehicle [Hz]."""
    setpoints: bool = False
    """true: nodes of the domain may send setpoints and commands, with the authority of a program."""
    px4_msgs: bool = True
    """true: also topics of px4_msgs. Vehicles with PX4 SITL have none from the bridge if `tools.microxrce` runs."""


class Microxrce(Strict):
    """Micro XRCE-DDS agent: connects every PX4 SITL of the arena to ROS 2, in the namespace of its vehicle's name."""

    port: Port = 8888
    """UDP port of the agent."""
    domain: DomainId = 0
    """ROS_DOMAIN_ID."""


class Tool(Strict):
    """A program that `arena up` starts in addition to the vehicles' programs."""

    argv: Annotated[Words, Field(min_length=1)]
    """The command and its arguments, as a list. They can contain [placeholders](placeholders.md) such as `{tools_url}`."""
    env: dict[str, str] = Field(default_factory=dict)
    """Environment variables to add. Their values can contain placeholders."""
    cwd: str | None = None
    """Folder in which the command runs. Default: the folder of arena.yaml."""
    restart: RestartMode = "never"
    """When to start the process again after it has ended."""
    needs: Words | None = None
    """Names of processes that must be ready first. Default: the router."""
    ready: Annotated[Ready, AfterValidator(_one_kind)] | None = None
    """When the tool counts as ready. Default: when it is started."""
    ros2: Ros2 | None = None
    """Settings of the tool `ros2`. They are written directly below it: `tools: {ros2: {setpoints: true}}`."""
    microxrce: Microxrce | None = None
    """Settings of the tool `microxrce`. They are written directly below it: `tools: {microxrce: {port: 8888}}`."""


def _monitor(keys: dict[str, Any]) -> dict[str, Any]:
    if keys:
        raise ValueError("monitor: expected true or false")
    return {"argv": MONITOR_ARGV, "restart": "on_failure"}


def _ros2(keys: dict[str, Any]) -> dict[str, Any]:
    return {"argv": ROS2_ARGV, "restart": "on_failure", "ros2": keys}


def _microxrce(keys: dict[str, Any]) -> dict[str, Any]:
    port = keys.get("port", Microxrce().port)
    argv = (XRCE_COMMAND, "udp4", "-p", str(port))
    # PX4 SITL starts its client with the world: the agent must be there before
    return {"argv": argv, "restart": "on_failure", "needs": (), "ready": {"port": port}, "microxrce": keys}


KNOWN: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    MONITOR: _monitor,
    ROS2: _ros2,
    MICROXRCE: _microxrce,
}
"""Tools that arena knows by name: name -> function that returns the keys of the tool from its settings."""


def known_tools(value: Any) -> Any:
    """Replace `monitor: true`, `ros2: {...}` and `microxrce: {...}` by their commands, and remove those with the value false."""
    if not isinstance(value, dict):
        return value
    found = {}
    for name, given in value.items():
        own_keys = isinstance(given, dict) and "argv" not in given and name != MONITOR
        if name not in KNOWN or not (isinstance(given, bool) or own_keys):
            found[name] = given
        elif given is not False:
            found[name] = KNOWN[name]({} if given is True else dict(given))
    return found
