"""PX4's parameters under the names, units and meanings of the vehicle's version, 1.9 to 1.18.

`table` reads the facts (px4_parameters.csv), `renames` says what became of a name (its table is `changes`), `meanings` says
which values make a failsafe do what, `delays` how long it waits before.

How px4_parameters.csv was made: PX4's own extraction (Tools/serial/generate_config.py, Tools/module_config/generate_params.py,
src/lib/parameters/px_process_params.py) ran on each tag over all modules, with every serial port, the outputs of fmu-v5 with an
I/O board and, where they exist, those of px4_sitl laid over them; `python -m arena.params.facts.regenerate` wrote its parameters.xml
as rows. So a board has fewer names than the table, and may have more outputs. A default is the parameter's own: an airframe or
a board may start from another. The head of the file names the tag of each version; where it says `~` instead of `=` there was
no released tag, and `assumed` is true.
"""
