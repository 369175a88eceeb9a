"""Flights of two real vehicles with random faults: the radios and airframes, the faults, and the rules that each flight must keep."""
