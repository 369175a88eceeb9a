"""Entry point of `python -m arena.cli`, which does the same as the command `arena`."""

import sys

from arena.cli import main

sys.exit(main())
