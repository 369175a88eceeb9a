"""Context of a member of the fused arena (a part such as the router): configuration and reports.

A member is a part of the arena, such as the router or the recorder. Normally, each of these parts is a process of its own. In the
fused arena (`arena.fused`), all members run in one process.
"""

from __future__ import annotations

from typing import Any

from arena.process_context import ProcessContext


class MemberContext(ProcessContext):
    """Context of one member (part) of the fused arena: its configuration, and reports to the supervisor.

    Each report carries the member's name, because the members share one connection to the supervisor.

    process: context of the process that runs all members.
    is_ready: True once the member has reported that it is ready.
    """

    def __init__(self, process: ProcessContext, settings: dict[str, Any]) -> None:
        super().__init__(str(settings["name"]), settings, None)
        self._process = process
        self.is_ready = False

    @property
    def orphaned(self) -> bool:
        """Always False: members of the fused arena do not check whether the supervisor has died.

        The process that runs the members detects itself that the supervisor has died, and ends them all.
        """
        return False

    def ready(self, **facts: Any) -> None:
        """Report to the supervisor that this member (part of the fused arena) is ready.

        Only the first call sends a packet.

        facts: values that are sent in the same packet, such as {"uav1.armed": True}.
        """
        if not self.is_ready:
            self.is_ready = True
            super().ready(**facts)

    def send(self, packet: dict[str, Any]) -> bool:
        return self._process.send({**packet, "of": self.name})
