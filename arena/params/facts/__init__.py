"""Tables about PX4 parameters of versions 1.9 to 1.18: names, limits, changes between versions, failsafes.

parameter_table    px4_parameters.csv: name, type, unit, default, limits of every parameter, by version
parameter_changes  parameter_changes.csv: parameters that were removed, renamed or converted between two versions
failsafe_table     failsafe_actions.csv, failsafe_delays.csv: the parameter values of each failsafe action, and the delays
regenerate         writes px4_parameters.csv from PX4's own parameters.xml

How px4_parameters.csv was made: PX4's own scripts (Tools/serial/generate_config.py, Tools/module_config/generate_params.py,
src/lib/parameters/px_process_params.py) extracted the parameters of all modules from each tag, with every serial port and the
outputs of fmu-v5 with an I/O board. The outputs of px4_sitl were added for versions that have them. Then
`python -m arena.params.facts.regenerate` converted parameters.xml to rows.

A single board has fewer parameters than the table, and may have other outputs. The defaults are those of the parameters; an
airframe or board can change them. The head of the file names the tag of each version, after `=`. The sign `~` marks versions
that were not released yet.
"""
