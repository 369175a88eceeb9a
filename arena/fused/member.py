"""Context of a member of the fused arena: a part that runs in a process of its own in an arena of many processes."""

from __future__ import annotations

from typing import Any

from arena.process_context import ProcessContext


class MemberContext(ProcessContext):
    """Configuration of one member, and its reports to the supervisor, which carry the member's name.

    process: context of the process that runs all members.
    is_ready: True once the member has reported that it is ready.
    """

    def __init__(self, process: ProcessContext, settings: dict[str, Any]) -> None:
        super().__init__(str(settings["name"]), settings, None)
        self._process = process
        self.is_ready = False

    @property
    def orphaned(self) -> bool:
        """Always False: the process that runs the members decides when it ends."""
        return False

    def ready(self, **facts: Any) -> None:
        """Report to the supervisor that the member is ready. Only the first call sends a packet. facts: first facts."""
        if not self.is_ready:
            self.is_ready = True
            super().ready(**facts)

    def send(self, packet: dict[str, Any]) -> None:
        self._process.send({**packet, "of": self.name})
