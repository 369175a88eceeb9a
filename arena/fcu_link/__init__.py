"""The one wire to a flight controller, standing where a simulated autopilot stands. It guards the arming of real vehicles."""
