"""Tests that imports run one way between the rooms (docs/architecture.md), imports inside functions included."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1] / "arena"

GROUND = {
    "authority",
    "builtin_parameters",
    "background_writer",
    "closed_ports",
    "socket_watch",
    "shared_core",
    "constants",
    "datagrams",
    "errors",
    "preloaded",
    "fault_injection",
    "geomagnetism",
    "geometry",
    "kernels",
    "missing_reboots",
    "motion_check",
    "obstacle_surface",
    "obstacles",
    "wire",
    "clock",
    "clock_reading",
    "clock_server",
    "portable_math",
    "process_context",
    "process_ties",
    "process_title",
    "run_dirs",
    "signing_key",
    "simulation_speed",
    "thrust_curve",
    "vehicle_models",
    "transport",
    "whole_file",
}
MAY: dict[str, set[str]] = {
    "authority": {"constants", "transport", "wire"},
    "builtin_parameters": {"constants"},
    "background_writer": set(),
    "constants": set(),
    "datagrams": {"kernels", "transport"},
    "preloaded": set(),
    "errors": set(),
    "thrust_curve": {"errors", "portable_math"},
    "fault_injection": {"errors"},
    "geomagnetism": set(),
    "geometry": {"errors", "portable_math"},
    "kernels": {"constants", "errors"},
    "obstacle_surface": {"geometry", "portable_math"},
    "obstacles": {"geometry", "obstacle_surface", "portable_math"},
    "portable_math": set(),
    "missing_reboots": {"clock_reading", "errors", "whole_file", "wire"},
    "motion_check": {"constants", "geometry"},
    "clock": {"errors", "shared_core"},
    "clock_reading": set(),
    "clock_server": {"clock", "shared_core"},
    "closed_ports": {"transport"},
    "socket_watch": set(),
    "shared_core": set(),
    "process_context": {"background_writer", "errors", "process_title"},
    "process_ties": set(),
    "process_title": set(),
    "run_dirs": set(),
    "signing_key": {"errors", "wire"},
    "simulation_speed": set(),
    "vehicle_models": {"errors", "thrust_curve", "constants", "kernels", "portable_math"},
    "transport": {"errors"},
    "whole_file": set(),
    "wire": {"constants", "errors", "geometry", "kernels"},
    "mocap": {"errors"},  # the table of vendors; their packages are found by name
    "mocap.client": {"clock_reading", "datagrams", "errors", "geometry", "kernels", "mocap", "transport"},
    # PX4's parameters and their transfer to a vehicle; knows nothing of arenas
    "params": {
        "constants",
        "errors",
        "wire",
        "clock",
        "clock_reading",
        "run_dirs",
        "signing_key",
        "transport",
        "whole_file",
    },
    "mocap.emulator": GROUND | {"mocap"},
    # the processes that join the parts of other processes
    "replay": GROUND | {"flight_log", "fused", "mocap.client", "mocap.emulator", "recorder"},
    "fused": GROUND
    | {
        "sim",
        "mocap.client",
        "mocap.emulator",
        "pose_forwarder",
        "mavlink_router",
        "emulated_sensors",
        "recorder",
    },
    "schema": {
        "constants",
        "errors",
        "geometry",
        "wire",
        "clock",
        "thrust_curve",
        "transport",
        "mocap",
        "obstacles",
        "signing_key",
    },
    "plan": {
        "constants",
        "errors",
        "geometry",
        "wire",
        "clock",
        "thrust_curve",
        "transport",
        "vehicle_models",
        "geomagnetism",
        "params",
        "schema",
        "simulation_speed",
        "mocap",
    },
    "supervisor": GROUND | {"schema", "plan"},
    # tool rooms and what a user imports may read the schema and the plan
    "flight_log": GROUND,
    "log_download": GROUND | {"params"},
    "report": GROUND | {"flight_log"},
    "render": GROUND | {"flight_log"},
    "top": GROUND | {"live_view"},
    "recorder": GROUND | {"mocap.client", "flight_log"},
    "live_view": GROUND | {"mocap.client", "supervisor"},
    "monitor": GROUND | {"live_view", "emergency", "supervisor"},
    # the bridge to ROS 2 sends setpoints as a user program does
    "ros2": GROUND | {"mocap.client", "uav"},
    "trajectories": {"errors", "geometry", "portable_math"},
    "controllers": {"constants", "geometry", "portable_math", "trajectories"},
    "uav": GROUND | {"mocap", "mocap.client", "schema", "trajectories"},
    "compat": GROUND | {"uav"},  # the thesis's names over `arena.uav`
    "uav.group": GROUND | {"uav"},  # runs user programs, which import `arena.uav`
    "fly": GROUND | {"live_view", "supervisor", "trajectories", "uav"},
    "emergency": GROUND | {"schema", "plan"},
    "smoke": GROUND | {"schema", "plan", "supervisor", "report"},
    "campaign": GROUND | {"schema", "flight_log", "report", "smoke", "supervisor"},
    "cli": GROUND
    | {
        "mocap",
        "schema",
        "plan",
        "supervisor",
        "emergency",
        "flight_log",
        "log_download",
        "report",
        "render",
        "top",
        "fly",
        "params",
        "replay",
        "ros2",  # only the generator of the reference pages
        "smoke",
        "campaign",
        "monitor",
    },
}
# Rooms without a row: a package with a `__main__` is a process, one inside `mocap` holds a vendor's protocol.
PROCESS = GROUND | {"mocap.client"}
VENDOR = {"errors", "geometry", "kernels", "mocap", "mocap.client", "mocap.emulator", "transport"}
# Only the world's shell puts two cores together; the package re-exports the user's names.
EXCEPT: dict[str, set[str]] = {
    "sim/__main__.py": {"autopilot", "px4"},
    "__init__.py": {"fly", "uav"},
    "__main__.py": {"cli"},
}
HEAVY = {
    "pybullet": {"sim"},
    "mavsdk": {"uav"},
    "matplotlib": {"report"},
    "PIL": {"render"},
    "imageio_ffmpeg": {"render"},
    "plotly": {"report"},
    "serial": {"transport"},
    "pyulog": {"flight_log"},
    "rosbags": {"flight_log"},
    "pyarrow": {"campaign", "flight_log"},
    "ruckig": {"trajectories"},
    "foxglove": {"recorder"},
    "mcap": {"flight_log"},
    "ray": {"campaign"},
    "pygame": {"fly"},
    "cyclonedds": {"ros2"},
    "viser": {"monitor"},
    "trimesh": {"monitor"},
}


@cache  # three tests read every file
def imports(path: Path) -> tuple[tuple[str, bool], ...]:
    """Return (dotted module, whether it is imported together with the file) of every import of a file."""
    return tuple(_imports(path))


def _imports(path: Path) -> Iterator[tuple[str, bool]]:
    tree = ast.parse(path.read_text())
    top = {id(node) for node in tree.body}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name, id(node) in top) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports hide where they go"
            yield node.module or "", id(node) in top
            if node.module == "arena":
                yield from ((f"arena.{alias.name}", id(node) in top) for alias in node.names)


FILES = sorted(ROOT.rglob("*.py"))


def room_of(path: Path) -> str:
    """Return the room of a file: its top folder or module; the folders of `mocap/` are rooms of their own."""
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:2]) if parts[0] == "mocap" and len(parts) > 2 else parts[0]


def room_of_module(module: str) -> str:
    """Return the room of a dotted module of arena."""
    parts = module.split(".")[1:]
    in_folder = parts[0] == "mocap" and len(parts) > 1 and (ROOT / "mocap" / parts[1]).is_dir()
    return ".".join(parts[:2]) if in_folder else parts[0]


def may_import(room: str) -> set[str] | None:
    """Return the rooms that a room may import, None without a rule."""
    if room in MAY:
        return MAY[room]
    if room.startswith("mocap."):
        return VENDOR
    return PROCESS if (ROOT / room / "__main__.py").exists() or room == "autopilot" else None


def test_every_room_has_a_rule() -> None:
    rooms = {room_of(p) for p in FILES} - {"__init__", "__main__"}
    assert not {room for room in rooms if may_import(room) is None}


by_room = pytest.mark.parametrize("room", sorted({room_of(path) for path in FILES}))


def files_of(room: str) -> Iterator[tuple[str, Path]]:
    """Yield (name for messages, path) of every file of a room."""
    return ((str(path.relative_to(ROOT)), path) for path in FILES if room_of(path) == room)


@by_room
def test_room_imports_only_allowed_rooms(room: str) -> None:
    wrong = []
    for name, path in files_of(room):
        allowed = (may_import(room) or set()) | {room} | EXCEPT.get(name, set())
        for module, _ in imports(path):
            parts = module.split(".")
            if parts[0] != "arena" or len(parts) == 1 or parts[1].startswith("_") or module == "arena.UAV":
                continue
            if room_of_module(module) not in allowed:
                wrong.append(f"{name} imports {module}; {room} may import {sorted(allowed)}")
    assert not wrong, "\n".join(wrong)


@by_room
def test_heavy_packages_stay_in_their_room(room: str) -> None:
    wrong = []
    for name, path in files_of(room):
        for module, _ in imports(path):
            owners = HEAVY.get(module.split(".")[0])
            if owners is not None and room not in owners:
                wrong.append(f"{name} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_pymavlink_connections_are_not_used() -> None:
    for path in FILES:
        assert not [m for m, _ in imports(path) if m == "pymavlink.mavutil"], path
