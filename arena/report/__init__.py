"""Results of finished flights: figures, texts, plots and pages.

The package reads the files of a run. It starts no processes.
"""
