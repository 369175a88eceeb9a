"""Entry point of `python -m arena`, which is the same as the command `arena`."""

import sys

from arena.cli import main

sys.exit(main())
