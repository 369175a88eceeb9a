"""Control of the built-in autopilot: setpoints, flight tasks, cascaded controllers and control allocation."""
