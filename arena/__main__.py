"""`python -m arena.cli`: the same as `arena`."""

import sys

from arena.cli import main

sys.exit(main())
