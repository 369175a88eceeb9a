"""Log files of flights, and the plots and summaries made of them.

The logger only receives: it must never send to a vehicle. Reports read a finished run and start nothing.
"""
