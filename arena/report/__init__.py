"""Results of finished flights: figures, texts, plots and pages. Reads the files of a run and starts no processes."""
