"""Outputs of a replay: router, motion capture server, recorder and truth page.

All times are times of the replay's clock.

Router and recorder are the same objects as in the fused arena; they run in the process of the replay, so that each message is recorded
at exactly the time at which it was recorded first.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from arena.fused.member import MemberContext
from arena.fused.memory_links import Inbox, RecorderLink, address
from arena.fused.router import FusedRouter
from arena.mocap.emulator.interface import open_server
from arena.process_context import ProcessContext
from arena.recorder.flight_recorder import FlightRecorder
from arena.replay.frames import FrameConverter, captured, sent_s
from arena.replay.parameters import ParameterReplies
from arena.replay.playback import STEP_NS, Playback, Step
from arena.replay.refusals import Refusals
from arena.replay.script import NS, Item, Kind, RecordedLine, Script, TrueState
from arena.replay.truth_rows import TruthRows
from arena.wire.flight_record import RecordedFrame
from arena.wire.truth_page import TruthWriter

_EXTRA_BODIES_FROM = 1001  # numbers of rigid bodies that belong to no vehicle


class _QuietContext(MemberContext):
    """Context of the replay's router. It reports no events, because the record already contains the router's events."""

    def event(self, text: str) -> None:
        """Discard the event."""


class Outputs:
    """Sender of the replayed messages. It also answers requests that programs send to the replay.

    process: context of the process.  slices: name of each member -> its configuration.
    sent: kind of message -> number of messages sent.
    """

    def __init__(
        self, process: ProcessContext, slices: Mapping[str, Mapping[str, Any]], script: Script, now_s: float
    ) -> None:
        self._process, self._names = process, [v.name for v in script.vehicles]
        self._contexts = {name: MemberContext(process, dict(slices[name])) for name in slices}
        self._contexts["router"] = _QuietContext(process, dict(slices["router"]))
        self._now_s = now_s
        self.sent = dict.fromkeys(Kind, 0)
        ids = [v.id for v in script.vehicles]
        self.refusals, self._parameters = Refusals(self._names, ids), ParameterReplies(script.parameters, ids)
        mocap = self._contexts["mocap"]
        numbers = {str(b["name"]): int(b["number"]) for b in mocap.settings["bodies"]}
        extra = sorted(set(script.bodies) - numbers.keys())
        numbers |= {name: _EXTRA_BODIES_FROM + i for i, name in enumerate(extra)}
        bodies = [{"name": name, "number": number} for name, number in numbers.items()]
        self._server = open_server({**mocap.settings, "bodies": bodies})
        self._frames = FrameConverter(numbers)
        self._truth_path = Path(process.settings["truth"])
        self._truth_page = TruthWriter(self._truth_path, len(self._names), period_s=1e-9 * STEP_NS)
        self._truth = TruthRows(len(self._names))
        self._inbox: Inbox = []
        self._recorder = FlightRecorder(self._contexts["recorder"], now_s, own_events=False)
        self._router = FusedRouter(
            self._contexts["router"],
            lambda: self._now_s,
            frozenset(range(len(self._names))),
            self._inbox,
        )
        settings = self._contexts["recorder"].settings
        self._copies = RecorderLink(address(settings, "listen"), self._router.sockets, settings["vehicles"])
        self._router.record_in(self._copies)
        mocap.ready()
        self._contexts["recorder"].ready()

    def send(self, step: Step) -> None:
        """Send the messages of one replay step."""
        self._now_s = step.clock_ns / NS
        shift_s, jumped = step.shift_ns / NS, step.jumped
        for item in step.items:
            self.sent[item.kind] += 1
            self._send(item, shift_s, jumped=jumped)
            jumped = jumped and item.kind is not Kind.FRAME
        if self._truth.fresh:
            truth = self._truth.take(self._now_s)
            self._truth_page.write(truth)
            self._recorder.on_truth(truth, self._now_s)
        self._router.step(self._now_s)
        self._record_copies()

    def serve(self, playback: Playback, wall: float) -> None:
        """Answer the requests and commands that programs have sent. The replay's time does not advance.

        wall: monotonic [s].
        """
        self._router.drain(self._now_s)
        waiting = self._inbox[:]
        self._inbox.clear()
        for vehicle, _, data in waiting:
            replies = self.refusals.on_datagram(vehicle, data, playback.state, self._now_s)
            for reply in replies + self._parameters.on_datagram(vehicle, data, playback.record_ns):
                self._router.from_vehicle(vehicle, reply, self._now_s)
        for vehicle, reply in self._parameters.next_values(playback.record_ns):
            self._router.from_vehicle(vehicle, reply, self._now_s)
        for text in self.refusals.take_events():
            self._process.event(text)
        self._server.answer(wall)
        self._record_copies()
        self._recorder.tick(self._now_s, wall)

    def close(self) -> None:
        """Write the remaining data of the new record, and close all sockets and files."""
        self._record_copies()
        self._recorder.close(self._now_s)
        self._copies.close()
        self._contexts["router"].stats(self._router.stats())
        self._router.close()
        self._server.close()
        self._truth_path.unlink(missing_ok=True)

    def on_request(self, request: Mapping[str, Any]) -> None:
        """Pass a request of the supervisor to the router."""
        self._router.on_request(request, self._now_s)

    def _send(self, item: Item, shift_s: float, *, jumped: bool) -> None:
        payload = item.payload
        match item.kind:
            case Kind.DOWN if isinstance(payload, bytes):
                self._router.from_vehicle(item.vehicle, payload, self._now_s)
            case Kind.UP if isinstance(payload, bytes):
                self._recorder.on_datagrams([(self._names[item.vehicle], True, payload, self._now_s)])
            case Kind.FRAME if isinstance(payload, RecordedFrame):
                measured = self._frames.measured(payload, shift_s, jumped=jumped)
                self._server.send(measured, sent_s(payload, shift_s), time.monotonic())
                self._recorder.on_frame(captured(payload, shift_s), payload.simulated, self._now_s)
            case Kind.TRUTH if isinstance(payload, TrueState):
                self._truth.set(item.vehicle, payload)
            case Kind.EVENT if isinstance(payload, RecordedLine):
                self._recorder.on_event(payload.line, payload.fields, self._now_s)
                self._report(payload)
            case _:
                pass

    def _report(self, line: RecordedLine) -> None:
        """Report a recorded event again, so that the event log of the replay contains it."""
        text, by = line.fields.get("event"), str(line.fields.get("process", ""))
        if isinstance(text, str):
            self._process.event(f"recorded: {by}: {text}" if by else f"recorded: {text}")

    def _record_copies(self) -> None:
        """Record the datagrams that the router has passed on, and the references of running user programs."""
        if datagrams := self._copies.receive(self._now_s):
            self._recorder.on_datagrams(datagrams)
