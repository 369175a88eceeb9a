"""Controllers for user programs: functions and classes that compute setpoints, and do not send them."""

from arena.controllers.formation import FormationLaw, formation_reference
from arena.controllers.position_pid import AttitudeThrust, Gains, PositionPid, attitude_thrust

__all__ = ["AttitudeThrust", "FormationLaw", "Gains", "PositionPid", "attitude_thrust", "formation_reference"]
