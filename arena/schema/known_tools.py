"""Commands of the tools that arena knows by name, such as `monitor: true` or `bag: {topics: [/uav1/pose]}`.

It also contains when these tools are ready, and what they need on this computer.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from arena.schema.ports import GROUND_STATION
from arena.schema.tools import ARENA, ROS2_MODULE, ROS2_SLICE, Mavros, Microxrce, Qgroundcontrol, Tool

MONITOR, ROS2, MICROXRCE = "monitor", "ros2", "microxrce"
MAVROS, BAG, QGROUNDCONTROL = "mavros", "bag", "qgroundcontrol"
MONITOR_ARGV = (ARENA, "monitor", "--run", "{run}")
"""Tool `monitor: true`: the page of `arena monitor`. The plan runs tools with the command `arena` by the arena's interpreter."""
ROS2_ARGV = (ROS2_MODULE, f"{{run}}/slices/{ROS2_SLICE}")
XRCE_COMMAND = "MicroXRCEAgent"
_ROS_COMMAND = "ros2"
_QGROUNDCONTROL_START_S = 120.0

Keys = dict[str, Any]


def _monitor(keys: Keys) -> Keys:
    if keys:
        raise ValueError("monitor: expected true or false")
    return {"argv": MONITOR_ARGV, "restart": "on_failure"}


def _ros2(keys: Keys) -> Keys:
    return {"argv": ROS2_ARGV, "restart": "on_failure", "ros2": keys}


def _microxrce(keys: Keys) -> Keys:
    port = keys.get("port", Microxrce().port)
    argv = (XRCE_COMMAND, "udp4", "-p", str(port))
    # PX4 SITL starts its client with the world: the agent must be there before
    return {"argv": argv, "restart": "on_failure", "needs": (), "ready": {"port": port}, "microxrce": keys}


def _mavros(keys: Keys) -> Keys:
    """Return the tool MAVROS with its command. MAVROS connects to the MAVLink router, at the vehicle's tools port.

    Programs and SDKs bind the other ports. MAVROS binds any free port and sends first.
    """
    launch, namespace = keys.get("launch", Mavros().launch), keys.get("namespace", Mavros().namespace)
    file = (str(launch),) if "/" in str(launch) else ("mavros", str(launch))
    url = "fcu_url:=udp://{address}:0@{address}:{tools_port}/"
    argv = (_ROS_COMMAND, "launch", *file, url, "gcs_url:=", "tgt_system:={id}", f"namespace:={namespace}")
    ready = {"log": "CON: Got HEARTBEAT, connected", "timeout_s": 60.0}
    return {"argv": argv, "restart": "on_failure", "ready": ready, "mavros": keys}


def _bag(keys: Keys) -> Keys:
    """Return the recorder of ROS 2 topics (`ros2 bag record`) as a tool.

    The topics are given as a regular expression, because Humble and later versions need different forms of lists.
    """
    topics, storage = keys.get("topics"), keys.get("storage")
    chosen: tuple[str, ...] = ("-a",)
    if isinstance(topics, list | tuple):
        chosen = ("--regex", f"^({'|'.join(re.escape(str(topic)) for topic in topics)})$")
    argv = (
        _ROS_COMMAND,
        "bag",
        "record",
        "-o",
        "{run}/bag",
        *(("-s", str(storage)) if storage else ()),
        *chosen,
    )
    return {"argv": argv, "needs": (), "ready": {"log": r"Recording\.\.\.|Listening for topics"}, "bag": keys}


def _qgroundcontrol(keys: Keys) -> Keys:
    command = keys.get("command", Qgroundcontrol().command)
    ready = {"port": GROUND_STATION, "timeout_s": _QGROUNDCONTROL_START_S}
    return {"argv": (str(command),), "needs": (), "ready": ready, "qgroundcontrol": keys}


KNOWN: dict[str, Callable[[Keys], Keys]] = {
    MONITOR: _monitor,
    ROS2: _ros2,
    MICROXRCE: _microxrce,
    BAG: _bag,
    QGROUNDCONTROL: _qgroundcontrol,
}
"""Tools of the whole arena: name -> function that returns the keys of the tool from its settings."""
KNOWN_OF_VEHICLE: dict[str, Callable[[Keys], Keys]] = {MAVROS: _mavros}
"""The same for tools of one vehicle."""


def known_tools(value: Any) -> Any:
    """Replace known tools such as `monitor: true` in the arena's `tools` by their commands.

    Tools with the value false are removed.
    """
    found = _replaced(
        value, KNOWN, KNOWN_OF_VEHICLE, "belongs to a vehicle. Write it under `defaults: {tools: ...}`"
    )
    return (
        {name: tool for name, tool in found.items() if tool is not None} if isinstance(found, dict) else found
    )


def known_tools_of_vehicle(value: Any) -> Any:
    """Replace known tools such as `mavros: {...}` in a vehicle's `tools` by their commands.

    The value false gives None.
    """
    return _replaced(
        value, KNOWN_OF_VEHICLE, KNOWN, "serves the whole arena. Write it under `tools` of the arena"
    )


def _replaced(
    value: Any,
    known: Mapping[str, Callable[[Keys], Keys]],
    elsewhere: Mapping[str, Callable[[Keys], Keys]],
    where: str,
) -> Any:
    if not isinstance(value, dict):
        return value
    found = {}
    for name, given in value.items():
        short = isinstance(given, bool) or (
            isinstance(given, dict) and "argv" not in given and name != MONITOR
        )
        if short and name in elsewhere:
            raise ValueError(f"{name} {where}")
        if not short or name not in known:
            found[name] = given
        else:
            found[name] = None if given is False else known[name]({} if given is True else dict(given))
    return found


@dataclass(frozen=True, kw_only=True)
class Requirement:
    """Command line tool or ROS 2 package that a known tool needs on this computer.

    ros_package: name of a ROS 2 package; "" for none. how: sentence that says how to get a missing command or package.
    """

    ros_package: str = ""
    how: str


_SOURCE = "then run `source /opt/ros/$ROS_DISTRO/setup.bash` before `arena up`."
_ROS = f"Install ROS 2 (docs.ros.org), {_SOURCE}"


def requirement(tool: Tool) -> Requirement | None:
    """Return the program or ROS 2 package that a tool needs on this computer, or None if no need is known."""
    if tool.microxrce is not None:
        agent = "Build it from github.com/eProsima/Micro-XRCE-DDS-Agent, or install the snap micro-xrce-dds-agent."
        return Requirement(how=agent)
    if tool.mavros is not None:
        how = f"Install it with `sudo apt install ros-$ROS_DISTRO-mavros`, {_SOURCE}"
        return Requirement(ros_package=MAVROS, how=how)
    if tool.bag is not None:
        return Requirement(ros_package="ros2bag", how=_ROS)
    if tool.qgroundcontrol is not None:
        how = "Download QGroundControl-x86_64.AppImage from qgroundcontrol.com, make it executable, "
        return Requirement(how=f"{how}and write `tools: {{qgroundcontrol: {{command: PATH}}}}`.")
    return None
