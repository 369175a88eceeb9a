"""The pydantic models of `tools`: programs that run in addition to the vehicles' programs.

It contains their readiness probes, and the settings of the tools that arena knows by name.
`known_tools` contains the commands of these tools.
"""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from arena.schema.base import Address, Port, Strict

ARENA, ROS2_MODULE, ROS2_SLICE = "arena", "arena.ros2", "ros2.json"
MODULES = frozenset({ARENA, ROS2_MODULE})
"""First words of `argv` that are modules of arena, which arena's Python runs."""

Words = tuple[str, ...]
RestartMode = Literal["never", "on_failure", "always"]
DomainId = Annotated[int, Field(ge=0, le=232)]
Topic = Annotated[str, Field(pattern=r"^/[A-Za-z0-9_/]+$")]


def _pattern(text: str) -> str:
    try:
        re.compile(text)
    except re.error as error:
        raise ValueError(f"expected a regular expression in Python's syntax: {error}") from error
    return text


class Ready(Strict):
    """Readiness probe of a tool. Set exactly one of log, port, file and delay_s."""

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
    """Bridge to ROS 2: poses and telemetry as ROS 2 topics, and setpoints from ROS 2.

    ROS 2 need not be installed.
    """

    domain: DomainId = 0
    """ROS_DOMAIN_ID."""
    address: Address | None = None
    """Numeric address of the network interface. Default: loopback, so that only nodes on this computer take part."""
    rate_hz: Annotated[float, Field(gt=0, le=200)] = 30.0
    """Most messages per second on each topic of a vehicle [Hz]."""
    setpoints: bool = False
    """true: nodes of the domain may send setpoints and commands, with the authority of a program."""
    px4_msgs: bool = True
    """Publish also topics of px4_msgs. If `tools.microxrce` runs, PX4 SITL publishes these topics itself, and the bridge does not."""


class Microxrce(Strict):
    """Micro XRCE-DDS agent, which connects every PX4 SITL of the arena to ROS 2.

    The namespace is the vehicle's name.
    """

    port: Port = 8888
    """UDP port of the agent."""
    domain: DomainId = 0
    """ROS_DOMAIN_ID."""


class Mavros(Strict):
    """MAVROS (`ros2 launch mavros px4.launch`) for one vehicle, connected to the MAVLink router at the vehicle's tools port."""

    namespace: str = "{ns}/mavros"
    """ROS namespace, so that the state is the topic `/uav1/mavros/state`. It can contain placeholders."""
    launch: str = "px4.launch"
    """Launch file: one of the package `mavros`, or a path."""
    domain: DomainId | None = None
    """ROS_DOMAIN_ID. Default: that of `ros2` or `microxrce`, else that of the shell in which `arena up` runs."""


class Bag(Strict):
    """Recorder of ROS 2 topics, `ros2 bag record`, into the folder `bag` of the run folder."""

    topics: Annotated[tuple[Topic, ...], Field(min_length=1)] | None = None
    """Names of the topics, such as `/uav1/pose`. Default: all topics."""
    storage: Literal["mcap", "sqlite3"] | None = None
    """Format of the files. Default: that of the installed ROS 2."""
    domain: DomainId | None = None
    """ROS_DOMAIN_ID. Default: that of `ros2` or `microxrce`, else that of the shell in which `arena up` runs."""


class Qgroundcontrol(Strict):
    """QGroundControl on this computer. It connects to the vehicles at UDP port 14550 automatically."""

    command: Annotated[str, Field(min_length=1)] = "QGroundControl.AppImage"
    """The program: a command in `PATH`, or a path relative to arena.yaml."""


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
    mavros: Mavros | None = None
    """Settings of the tool `mavros` of a vehicle. They are written directly below it: `tools: {mavros: {domain: 5}}`."""
    bag: Bag | None = None
    """Settings of the tool `bag`. They are written directly below it: `tools: {bag: {topics: [/uav1/pose]}}`."""
    qgroundcontrol: Qgroundcontrol | None = None
    """Settings of the tool `qgroundcontrol`. They are written directly below it."""
