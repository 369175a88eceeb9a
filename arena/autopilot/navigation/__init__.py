"""Navigation of the built-in autopilot: AUTO modes, missions and geofences."""
