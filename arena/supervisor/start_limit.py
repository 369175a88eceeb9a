"""Limit of the number of processes that start and import their packages at the same time.

Loading Python and its packages keeps a core busy for about 0.2 s. Thirty processes that load at the same time would starve the
world. Therefore at most as many processes load as there are cores. A process of the fork server has nothing to load.
"""

from __future__ import annotations

import os
from collections.abc import Collection

from arena.plan.model import ProcessSpec
from arena.supervisor.fork_client import ForkClient

MAX_LOADING = max(2, os.cpu_count() or 2)
_LOADING_S, _SILENT_LOADING_S = 1.0, 0.3
"""Longest time for which a process counts as loading; the second one is for processes that send no reports [s]."""


class StartLimit:
    """Limit of how many new processes may load their Python packages at the same time.

    Restarts never wait, because they may happen in flight.

    forks: client of the fork server, which must have imported its packages first; None without a fork server.
    """

    def __init__(self, forks: ForkClient | None) -> None:
        self._forks, self._waits_for_forks = forks, False
        self._until: dict[str, float] = {}

    def update(self, now: float) -> None:
        """Check whether the fork server has loaded its packages. Until then, no process starts for the first time.

        now: monotonic [s].
        """
        self._waits_for_forks = self._forks is not None and self._forks.loading(now)

    def drop_loaded(self, running: Collection[str], now: float) -> None:
        """Stop counting the processes that have ended or had enough time to load their packages.

        now: monotonic [s].
        """
        self._until = {name: until for name, until in self._until.items() if until > now and name in running}

    @property
    def allows_start(self) -> bool:
        """True if another process may start for the first time."""
        return len(self._until) < MAX_LOADING and not self._waits_for_forks

    def add(self, spec: ProcessSpec, now: float, *, forked: bool) -> None:
        """Count a new process as one that loads its packages, unless the fork server started it.

        forked: the fork server started it.
        now: monotonic [s].
        """
        if not forked:
            self._until[spec.name] = now + (_LOADING_S if spec.ready == "reported" else _SILENT_LOADING_S)

    def on_loaded(self, name: str) -> bool:
        """Stop counting a process that has loaded its packages. Return whether it was counted."""
        return self._until.pop(name, None) is not None
