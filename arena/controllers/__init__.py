"""Controllers for user programs: pure functions and small classes without a clock. They send nothing."""

from arena.controllers.formation import FormationLaw, formation_reference
from arena.controllers.position_pid import AttitudeThrust, Gains, PositionPid, attitude_thrust

__all__ = ["AttitudeThrust", "FormationLaw", "Gains", "PositionPid", "attitude_thrust", "formation_reference"]
