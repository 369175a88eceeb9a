"""The panic path: land-all and kill-all. They need no supervisor, router, mocap or monitor alive.

This room stays light (no numpy, no schema): what it does must have left the computer well within a second.
"""
