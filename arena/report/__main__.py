"""Command line of the report: `python -m arena.report RUN`."""

import sys

from arena.report.run_report import main

if __name__ == "__main__":
    sys.exit(main())
