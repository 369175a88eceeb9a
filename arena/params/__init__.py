"""Tools for PX4 parameters: tables by PX4 version, generation, checks, comparison, and transfer.

facts/         tables of parameters, changes and failsafes by PX4 version
generation/    makes parameters of one version from requirements                          (imports facts)
checks/        finds problems in a set of parameters; compares two sets                   (imports facts)
transfer/      reads and writes a vehicle's parameters over MAVLink, by UDP or serial
param_files    reads `.params` files and ULogs                                            (imports facts)

This package does not depend on arena.yaml: `arena.plan.firmware` turns an arena into requirements.
"""
