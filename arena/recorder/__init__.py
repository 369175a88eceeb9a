"""Log files of flights, and the plots and summaries computed from them.

The logger must never send data to a vehicle. The report reads the files of a finished run and starts no processes.
"""
