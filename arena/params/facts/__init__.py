"""Facts about PX4's parameters of 1.9 to 1.18, as tables: names and limits, changes between versions, failsafes.

parameter_table    px4_parameters.csv: name, type, unit, default, limits of every parameter, by version
parameter_changes  parameter_changes.csv: what was removed, renamed or converted between two versions
failsafe_table     failsafe_actions.csv, failsafe_delays.csv: which values make a failsafe take which action, and when
regenerate         writes px4_parameters.csv from PX4's own parameters.xml

How px4_parameters.csv was made: PX4's own extraction (Tools/serial/generate_config.py, Tools/module_config/generate_params.py,
src/lib/parameters/px_process_params.py) ran on each tag over all modules, with every serial port, the outputs of fmu-v5 with an I/O
board and, where they exist, those of px4_sitl on top; `python -m arena.params.facts.regenerate` turned its parameters.xml into rows.
So one board has fewer parameters than the table, and may have more outputs. A default is the parameter's own; an airframe or a board
may start from another one. The head of the file names the tag of each version, `~` instead of `=` where no tag was released yet.
"""
