"""The real PX4: finding it, its folder and startup, and the lockstep link between it and the world."""
