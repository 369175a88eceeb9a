"""Time bar of a replay on the live page: shows the position, and requests jumps and pauses."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from arena.errors import RunError
from arena.live_view import Playback
from arena.supervisor import Control, open_run

if TYPE_CHECKING:
    import viser

_FOLLOW_AFTER_S = 2.0  # after a jump, the bar waits so long for the replay before it shows the position again
_STEP_S = 0.1


class TimeBar:
    """Slider and pause button of a replay. All browsers share them.

    gui: widgets of the viser server. Without a replay, slider and button are hidden.
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        from viser import Icon

        self._slider: Any = gui.add_slider("time [s]", 0.0, 1.0, _STEP_S, 0.0, visible=False, order=0.5)
        self._button = gui.add_button("PAUSE", icon=Icon.PLAYER_PAUSE, visible=False, order=0.6)
        self._run: Path | None = None
        self._paused = False
        self._jumped_at = float("-inf")
        self._slider.on_update(self._on_slider)
        self._button.on_click(self._on_button)

    def update(self, run: Path | None, playback: Playback | None) -> None:
        """Show the present position of the replay. run: run folder. playback: None hides the bar."""
        self._run = run
        is_replay = playback is not None
        if self._slider.visible != is_replay:
            self._slider.visible = self._button.visible = is_replay
        if playback is None:
            return
        if self._slider.max != playback.duration_s:
            self._slider.max = max(playback.duration_s, _STEP_S)
        if playback.paused != self._paused:
            self._paused = playback.paused
            self._button.label = "CONTINUE" if playback.paused else "PAUSE"
        if time.monotonic() - self._jumped_at > _FOLLOW_AFTER_S:
            self._slider.value = min(round(playback.time_s, 1), self._slider.max)

    async def _on_slider(self, event: Any) -> None:
        if event.client is not None and self._run is not None:  # a person moved it
            self._jumped_at = time.monotonic()
            request(self._run, seek_s=float(self._slider.value))

    async def _on_button(self, _: Any) -> None:
        if self._run is not None:
            request(self._run, pause=not self._paused)


def request(run: Path, **packet: Any) -> None:
    """Send a request, such as a jump or a pause, to the process of the replay, without waiting for its reply.

    The supervisor may be slow to reply. run: run folder. packet: keys of the request.
    """
    threading.Thread(target=_send, args=(run, packet), daemon=True).start()


def _send(run: Path, packet: dict[str, Any]) -> None:
    if (state := open_run(run)) is None:
        return
    try:
        control = Control(Path(state.rt) / "control.sock")
        control.ask(do="replay", **packet)
        control.close()
    except RunError as error:
        print(f"monitor: {error}", flush=True)
