"""PX4 software in the loop: its process, folder and startup, and the lockstep link between PX4 and the world."""
