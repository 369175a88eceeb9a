"""land-all and kill-all. They need no running supervisor, router, motion capture or monitor.

Only light modules are imported here (no numpy, no schema): the first command must be sent well within a second.
"""
