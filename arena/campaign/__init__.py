"""Campaigns: many simulated flights over seeds and settings, with a table of results and plots.

`sweep` reads the sweep file, `sampler` draws values, `design` lists the flights, `preparation` checks them. `store` keeps
one line per flight, `measures` computes the values of a flight, `table` and `report` show all flights. `fly` flies one
flight, `runner` flies all of them with worker processes, and `ray_cluster` flies them on several computers (`ray_task`
is the part of the other computers).
"""
