"""MAVLink of the built-in autopilot: commands, setpoints, telemetry, parameters and missions."""
