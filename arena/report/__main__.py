"""Command line that writes the report of a run: `python -m arena.report RUN`."""

import sys

from arena.report.run_report import main

if __name__ == "__main__":
    sys.exit(main())
