"""Title of a process, which `ps` shows."""

from __future__ import annotations

import os

_KEEP_ENVIRONMENT = "SPT_NOENV"
"""Variable of setproctitle. Without it, the title takes the memory in which the kernel finds the environment of the process."""


def set_title(title: str) -> None:
    """Set the title of this process, if the package setproctitle is installed.

    The environment stays readable in /proc: the supervisor finds the processes of its run by it, also after their parents ended.
    """
    try:
        import setproctitle
    except ImportError:  # the title is only for people
        return
    given = os.environ.get(_KEEP_ENVIRONMENT)
    os.environ[_KEEP_ENVIRONMENT] = "1"
    try:
        setproctitle.setproctitle(title)
    finally:
        if given is None:
            del os.environ[_KEEP_ENVIRONMENT]
        else:
            os.environ[_KEEP_ENVIRONMENT] = given
