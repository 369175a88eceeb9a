"""Physical and protocol constants that several packages use."""

from __future__ import annotations

GRAVITY_M_S2 = 9.80665
"""Standard gravity [m/s2] (ISO 80000-3). PX4's CONSTANTS_ONE_G has the same value."""

MONITOR_PORT = 8480
"""TCP port of the page of `arena monitor`. If it is taken, the next free one is used."""

PROCESS_ENV = (("OMP_NUM_THREADS", "1"), ("OPENBLAS_NUM_THREADS", "1"), ("PYTHONUNBUFFERED", "1"))
"""Environment variables of arena's processes. Without them, numpy's threads take the CPU cores that other processes need."""

LAND_TIMEOUT_S = 60.0
"""Default of the option --timeout of `arena land-all`: the command gives up after this wall time [s]."""

RUN_FOLDER, RUNTIME_FOLDER, OPEN_BRACE = "{run}", "{rt}", "{brace}"
"""Placeholders that the supervisor replaces when the run has its folders.

`{brace}` stands for `{` before a text that would otherwise be such a placeholder.
"""

REPORT_PROGRESS = "progress: "
"""Beginning of an output line of the report task that names its present step. `arena up` shows the step."""

PX4_HOME = "PX4_HOME"
"""Name of the environment variable in which the user gives the PX4 folder. It is not passed to PX4."""

POSE_PAGE = "page"
"""`kind` of a program's settings for motion capture if it reads the pose page (`arena.wire.pose_page`) instead of a vendor's server."""

MAX_ROTORS = 8
"""Largest number of rotors of a vehicle."""

INT32_MIN, INT32_MAX = -(2**31), 2**31 - 1

INT32_NOT_GIVEN = INT32_MAX
"""A latitude or longitude field of COMMAND_INT with this value is not given."""

REORDERED_MS = 500
"""A step back of SYSTEM_TIME.time_boot_ms by less is a message that arrived out of order; by more, a reboot [ms]."""

FORCE_ARM_DISARM = 21196.0
"""param2 of MAV_CMD_COMPONENT_ARM_DISARM that forces it: with param1 = 0 the motors stop, even in flight."""

OFFBOARD_LOSS_S = 1.0
"""Default of `failsafe.offboard_loss.after_s`, which is PX4's COM_OF_LOSS_T: time without setpoints until the failsafe acts [s]."""

MAX_MOCAP_LATENCY_MS = 1000
"""Largest `mocap.latency_ms` that a YAML may have [ms]."""
PILOT_HAS_CONTROL = "pilot has control"
"""STATUSTEXT with which a router or link process refuses a command, because a pilot flies the vehicle."""
