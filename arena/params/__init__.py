"""PX4 parameters: what they mean in every version, made from requirements, checked, compared, and transferred to vehicles.

facts/         tables of parameters, changes and failsafes by PX4 version
generation/    requirements of an arena -> parameters of one version                      (imports facts)
checks/        findings in a set of parameters; comparison of two sets                    (imports facts)
transfer/      reading and writing a vehicle's parameters over MAVLink, UDP and serial
param_files    reads `.params` files and ULogs                                            (imports facts)

This room knows no arena: `arena.plan.firmware` turns an arena into requirements.
"""
