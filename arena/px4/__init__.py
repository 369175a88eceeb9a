"""PX4 software in the loop (SITL): its process, its folder and startup, and its lockstep link to the world."""
