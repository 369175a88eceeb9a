"""The live page: receives the state of the arena 20 times a second, and draws it for all browsers."""

from __future__ import annotations

import asyncio
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from arena.geometry import world_from_ned
from arena.live_view import Settings, Snapshot
from arena.monitor import tables
from arena.monitor.client_view import PLOT_WINDOW_S, ClientView
from arena.monitor.commands import Commands
from arena.monitor.history import History
from arena.monitor.scene import MANY, Scene
from arena.monitor.time_bar import TimeBar

if TYPE_CHECKING:
    import viser

PICTURE_S, PLOT_S, TABLE_S = 0.05, 0.2, 0.5
AROUND_M = 4.0
"""Width of the space around the vehicles' start that a new browser shows [m]."""
_PANEL_WIDTH = 380


class Feed(Protocol):
    """Source of the arena states that the page draws, such as a `LiveFeed`.

    A test or a benchmark can use another source.

    waiting_for: why there is no arena; "" if there is one.
    """

    waiting_for: str

    def poll(self, now: float | None = None) -> Snapshot | None: ...


class Page:
    """The live page of one process `arena monitor`.

    All methods run in the thread of viser's event loop, because viser is not safe when several threads send messages.
    """

    def __init__(self, server: viser.ViserServer, feed: Feed, commands: Commands | None = None) -> None:
        self._server, self._feed = server, feed
        self.commands = Commands() if commands is None else commands
        self._snapshot: Snapshot | None = None
        self._run: Path | None = None
        self._scene: Scene | None = None
        self._history = History(seconds=PLOT_WINDOW_S)
        self._views: dict[int, ClientView] = {}
        self._next_plot = self._next_table = 0.0
        self._shown: dict[str, str] = {}
        self._build()
        server.on_client_connect(self._on_connect)
        server.on_client_disconnect(self._on_disconnect)

    async def draw(self) -> None:
        """Draw the page periodically, until the process ends.

        An error in a picture is printed once, and the next picture is drawn. The period is PICTURE_S.
        """
        printed: set[str] = set()
        due = time.monotonic()
        while True:
            try:
                self.step()
            except Exception as error:
                if (text := f"{type(error).__name__}: {error}") not in printed:
                    printed.add(text)
                    print(
                        f"monitor: a picture of the page was not drawn ({text})", file=sys.stderr, flush=True
                    )
            due = max(due + PICTURE_S, time.monotonic())
            await asyncio.sleep(due - time.monotonic())

    def step(self, now: float | None = None) -> None:
        """Update the page once with the newest state of the arena. now: monotonic [s]."""
        now = time.monotonic() if now is None else now
        snapshot = self._snapshot = self._feed.poll(now)
        run = None if snapshot is None else snapshot.run
        if run != self._run:
            self._change_arena(snapshot)
        if snapshot is not None and self._scene is not None:
            self._draw(snapshot, self._scene)
            added = self._history.add(snapshot.time_s, snapshot.fleet)
            if added and now >= self._next_plot:
                self._next_plot = now + PLOT_S
                for view in list(self._views.values()):
                    view.update_plots(self._history)
        if now >= self._next_table:
            self._next_table = now + TABLE_S
            self._update_tables(snapshot)

    def _draw(self, snapshot: Snapshot, scene: Scene) -> None:
        fleet = snapshot.fleet
        many = len(fleet.names) > MANY
        rows = {view.row for view in self._views.values()} if many else set(range(len(fleet.names)))
        if self._labels.value == "all":
            texts = [tables.label(fleet, i) if i in rows else fleet.names[i] for i in range(len(fleet.names))]
        elif self._labels.value == "none":
            texts = [""] * len(fleet.names)
        else:
            texts = [tables.label(fleet, i) if i in rows else "" for i in range(len(fleet.names))]
        scene.update(fleet, snapshot.time_s, texts, snapshot.paths)
        for view in list(self._views.values()):
            view.follow(fleet)

    def _build(self) -> None:
        """Add the widgets that all browsers share to the page."""
        from viser import Icon

        gui = self._server.gui
        gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, brand_color=(56, 152, 255)
        )
        gui.set_panel_label("arena monitor")
        self._status = gui.add_html(tables.status_html(None, ""), order=0.0)
        self._time_bar = TimeBar(gui)
        self._results = gui.add_html("", order=2.0)
        tabs = gui.add_tab_group(order=5.0)
        with tabs.add_tab("Vehicles", Icon.DRONE):
            self._vehicles = gui.add_html("")
        with tabs.add_tab("Events", Icon.LIST):
            self._details = gui.add_checkbox("details", initial_value=False)
            self._events = gui.add_html("")
        with tabs.add_tab("Processes", Icon.CPU):
            self._processes = gui.add_html("")
        with tabs.add_tab("View", Icon.EYE):
            self._labels = gui.add_dropdown("labels", ["some", "all", "none"])
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_PANEL_WIDTH)

    def _update_tables(self, snapshot: Snapshot | None) -> None:
        self._show(self._status, "status", tables.status_html(snapshot, self._feed.waiting_for))
        self._show(self._results, "results", tables.commands_html(self.commands.newest()))
        playback = None if snapshot is None else snapshot.playback
        self._time_bar.update(self._run, playback)
        if snapshot is None:
            return
        self._show(self._vehicles, "vehicles", tables.vehicles_html(snapshot.fleet))
        self._show(self._processes, "processes", tables.processes_html(snapshot.processes))
        self._show(self._events, "events", tables.events_html(snapshot.events, details=self._details.value))

    def _show(self, widget: Any, key: str, html: str) -> None:
        """Send the HTML of a widget to the browsers, if it has changed. key: name of the widget."""
        if self._shown.get(key) != html:
            self._shown[key] = html
            widget.content = html

    def _change_arena(self, snapshot: Snapshot | None) -> None:
        """Draw the room and the vehicles of a new arena. Draw nothing if `snapshot` is None (the arena has ended).

        After the end of an arena, its last picture stays until the next arena begins.
        """
        self._run = None if snapshot is None else snapshot.run
        if snapshot is None:
            return
        self._server.scene.reset()
        self._history = History(seconds=PLOT_WINDOW_S)
        look_at(self._server, snapshot.settings)
        self._scene = Scene(self._server, snapshot.settings)
        for view in list(self._views.values()):
            view.change_arena([v.name for v in snapshot.settings.vehicles])

    async def _on_connect(self, client: viser.ClientHandle) -> None:
        snapshot = self._snapshot
        names = [] if snapshot is None else [v.name for v in snapshot.settings.vehicles]
        view = ClientView(client, self.commands, vehicles=names, run=self._commanded_run)
        self._views[client.client_id] = view

    def _commanded_run(self) -> Path | None:
        """Return the run folder of the arena to which the page's buttons send commands.

        Returns None without an arena, and for a replay, because nobody can command a replay.
        """
        snapshot = self._snapshot
        return None if snapshot is None or snapshot.playback is not None else snapshot.run

    async def _on_disconnect(self, client: viser.ClientHandle) -> None:
        self._views.pop(client.client_id, None)


async def show(server: viser.ViserServer, feed: Feed) -> None:
    """Make the live page and draw it until the process ends. Run this in the event loop of the server."""
    await Page(server, feed).draw()


def look_at(server: viser.ViserServer, settings: Settings) -> None:
    """Set the initial camera of new browsers: south of the vehicles' start positions, looking at them."""
    north, east, up = settings.size_m
    starts = world_from_ned([v.start_n for v in settings.vehicles])
    low, high = starts.min(axis=0), starts.max(axis=0)
    middle = 0.5 * (low + high)
    width = min(float(max(high - low)) + AROUND_M, max(north, east))
    server.initial_camera.position = middle + np.array((0.3, -1.25, 0.7)) * max(width, up)
    server.initial_camera.look_at = middle + np.array((0.0, 0.0, min(0.3 * up, 1.5)))
    server.initial_camera.fov = 0.75
