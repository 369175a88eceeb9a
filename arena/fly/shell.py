"""Interactive Python shell of `arena shell`, in which `uav` is the connected vehicle.

The shell is IPython if it is installed, else that of Python.
"""

from __future__ import annotations

import code
import importlib
from typing import Any

from arena.fly.connect import Session

_HELP = """\
uav is {name}, {state}. Examples:
  uav.ekf.pos                                       estimated position [m] [NED]
  uav.start_offboard_mission()                      arm and enter OFFBOARD
  uav.set_pos_yaw([0, 0, -1], 0, 5)                 fly to a position for 5 s
  uav.hold_until(lambda: False, 10)                 hold for 10 s
  uav.auto_land()
Setpoints are sent only during a call: after {limit:g} s without one, the offboard failsafe of the autopilot lands the vehicle.
Ctrl-D leaves the shell, and lands a vehicle that this shell flies."""


def interact(session: Session) -> None:
    """Run an interactive Python shell with `uav`, the connected vehicle, until the user leaves it.

    The caller ends the session.
    """
    uav = session.uav
    uav.hold_until(lambda: uav.info.is_connected, 3.0)
    names: dict[str, Any] = {"uav": uav, "arena": importlib.import_module("arena")}
    names["np"] = importlib.import_module("numpy")
    state = "connected" if uav.info.is_connected else "NOT CONNECTED: no heartbeat yet"
    banner = _HELP.format(
        name=session.vehicle.name, state=state, limit=session.vehicle.settings.offboard_loss_s
    )
    try:
        embed = importlib.import_module("IPython").embed
    except ImportError:
        code.interact(banner=banner, local=names, exitmsg="")
        return
    print(banner, flush=True)
    embed(user_ns=names, banner1="", colors="neutral")
