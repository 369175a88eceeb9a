"""Log files of a flight, and after it pictures and a summary.

The logger only listens; it must never speak to a vehicle. Reports read what a run left behind and start
nothing.
"""
