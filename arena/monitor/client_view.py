"""Widgets of the live page that each browser has for itself: chosen vehicle, camera, plots and buttons.

Two people who look at the same arena can therefore not change the vehicle for which the other one presses a button.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from arena.live_view import FleetSnapshot
from arena.monitor.commands import Action, Commands
from arena.monitor.history import BY_TITLE, QUANTITIES, History, Quantity, plot
from arena.monitor.poses import world_positions
from arena.monitor.tables import plots_html

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]

FIRST_PLOTS = ("north [m]", "east [m]", "height [m]", "yaw [deg]")
NO_PLOT = "none"
PLOT_WINDOW_S = 30.0
_PLOT_HEIGHT, _PANEL_WIDTH = 140, 380
_LINE_COLOURS = ("#3ddc84", "#8b97ab", "#3898ff", "#facc15")
_NEAR_M = 2.0
AXIS_CLASS = "arena-axis"
HIDE_AXIS = f"<style>.u-legend .{AXIS_CLASS} {{display: none}}</style>"
"""Style sheet that removes the line that sets the range of an axis from the legends."""
_WORDS: dict[Action, str] = {"land": "LAND ALL", "kill": "KILL ALL", "hold": "HOLD ALL"}


class ClientView:
    """Widgets and camera of one browser that shows the live page.

    client: the browser.  commands: gives the emergency commands.
    vehicles: names of the vehicles.  run: returns the folder of the run that the buttons command; None while there is none.
    """

    def __init__(
        self,
        client: viser.ClientHandle,
        commands: Commands,
        *,
        vehicles: Sequence[str],
        run: Callable[[], Path | None],
    ) -> None:
        from viser import Icon

        self._client, self._commands, self._run = client, commands, run
        self._vehicles = tuple(vehicles)
        self._followed_w: Array | None = None
        gui = client.gui
        names = list(vehicles) or ["-"]
        land_all = gui.add_button("LAND ALL", color="yellow", icon=Icon.PLANE_ARRIVAL, order=1.0)
        kill_all = gui.add_button("KILL ALL", color="red", icon=Icon.SKULL, order=1.1)
        # viser calls coroutines in the thread of its event loop, where the page draws, too
        land_all.on_click(_calls(lambda: self._confirm("land")))
        kill_all.on_click(_calls(lambda: self._confirm("kill")))
        self._vehicle = gui.add_dropdown("vehicle", names, order=3.0)
        self._follow = gui.add_checkbox("camera follows", initial_value=False, order=3.1)
        self._hold = gui.add_button(f"HOLD {names[0]}", color="blue", icon=Icon.PLAYER_PAUSE, order=3.2)
        self._land = gui.add_button(f"LAND {names[0]}", color="yellow", icon=Icon.ARROW_DOWN, order=3.3)
        self._vehicle.on_update(_calls(self._on_vehicle))
        self._follow.on_update(_calls(self._stop_following))
        self._hold.on_click(_calls(lambda: self._give("hold", (self._vehicle.value,))))
        self._land.on_click(_calls(lambda: self._give("land", (self._vehicle.value,))))
        panel = gui.add_panel()
        tab = panel.add_tab("Plots", Icon.CHART_LINE)
        with tab:
            self._plotted = gui.add_html(plots_html(names[0], 0), order=0.0)
            gui.add_html(HIDE_AXIS, order=100.0)
        self._plots = [_Plot(gui, tab, k + 1, title) for k, title in enumerate(FIRST_PLOTS)]
        panel.dock_left()
        panel.set_width(_PANEL_WIDTH)
        self._panel = panel

    @property
    def row(self) -> int:
        """Index of the vehicle that the user has chosen."""
        return self._vehicles.index(self._vehicle.value) if self._vehicle.value in self._vehicles else 0

    def follow(self, fleet: FleetSnapshot) -> None:
        """Move the camera with the chosen vehicle if `camera follows` is ticked. Call it for every picture."""
        if not self._follow.value or self._client.camera is None:
            return
        p_n = fleet.p_n[self.row]
        if not np.isfinite(p_n).all():
            return
        p_w = world_positions(p_n[None])[0]
        camera = self._client.camera
        if self._followed_w is None:
            away = camera.position - p_w
            away *= min(1.0, _NEAR_M / max(float(np.linalg.norm(away)), 1e-6))
            with self._client.atomic():
                camera.position = p_w + away
                camera.look_at = p_w
        elif float(np.linalg.norm(move := p_w - self._followed_w)) > 1e-3:
            with self._client.atomic():
                camera.position = camera.position + move
                camera.look_at = p_w
        self._followed_w = p_w

    def update_plots(self, history: History) -> None:
        """Draw the plots of the chosen vehicle again, with new samples."""
        found = history.of_vehicle(self.row)
        if found is None:
            return
        for one in self._plots:
            one.update(*found)

    def change_arena(self, vehicles: Sequence[str]) -> None:
        """Show the vehicles of another arena in the list from which the user chooses a vehicle."""
        self._vehicles = tuple(vehicles)
        self._vehicle.options = list(vehicles) or ["-"]
        self._on_vehicle()

    def _on_vehicle(self) -> None:
        self._hold.label = f"HOLD {self._vehicle.value}"
        self._land.label = f"LAND {self._vehicle.value}"
        self._plotted.content = plots_html(self._vehicle.value, self.row)
        self._stop_following()

    def _stop_following(self) -> None:
        self._followed_w = None

    def _give(self, action: Action, vehicles: Sequence[str]) -> None:
        run = self._run()
        if run is None or not vehicles or vehicles[0] not in self._vehicles:
            self._refuse("the page shows no arena that can be commanded")
            return
        self._commands.give(action, run, vehicles)

    def _refuse(self, why: str) -> None:
        """Show the user that a button has sent no command, and why.

        Otherwise the user would wait for a result.
        """
        self._client.add_notification(
            "NOT COMMANDED", f"{why}. Use `arena land-all` in a terminal", color="red"
        )

    def _confirm(self, action: Action) -> None:
        """Show the confirmation dialog of LAND ALL or KILL ALL, which names the vehicles."""
        vehicles, run = self._vehicles, self._run()
        if run is None or not vehicles:
            self._refuse("the page shows no arena that can be commanded")
            return
        gui = self._client.gui
        named = ", ".join(vehicles)
        with gui.add_modal(_WORDS[action]) as dialog:
            if action == "kill":
                gui.add_markdown(
                    f"**This stops the motors of {named} at once. Flying vehicles fall.** To land, use LAND ALL.",
                    order=0.0,
                )
            else:
                gui.add_markdown(
                    f"This lands **{named}** where they are. Their programs cannot fly again before `arena release`.",
                    order=0.0,
                )
            verb = "Stop the motors of" if action == "kill" else "Land"
            whom = named if len(vehicles) <= 3 else f"all {len(vehicles)} vehicles"
            # the browser focuses the first button: the key Enter must not stop motors, but may land
            first, second = (2.0, 1.0) if action == "kill" else (1.0, 2.0)
            yes = gui.add_button(f"{verb} {whom}", color="red" if action == "kill" else "yellow", order=first)
            no = gui.add_button("Cancel", color="gray", order=second)

        def confirmed() -> None:
            dialog.close()
            if run != self._run():  # another arena may have vehicles with the same names
                self._refuse("the page now shows another arena than when you pressed the button")
                return
            self._give(action, vehicles)

        yes.on_click(_calls(confirmed))
        no.on_click(_calls(dialog.close))


def _calls(function: Callable[[], None]) -> Callable[[Any], Coroutine[Any, Any, None]]:
    """Convert a function to a coroutine function, which viser can call for an event such as a click."""

    async def on_event(_: Any) -> None:
        function()

    return on_event


class _Plot:
    """A plot, and the list from which the user chooses its quantity."""

    def __init__(self, gui: viser.GuiApi, tab: viser.GuiTabHandle, number: int, title: str) -> None:
        self._gui, self._tab, self._order = gui, tab, 10.0 * number
        options = [NO_PLOT, *(quantity.title for quantity in QUANTITIES)]
        with tab:
            self._choice = gui.add_dropdown(f"plot {number}", options, initial_value=title, order=self._order)
        self._shown = ""
        self._chart: viser.GuiUplotHandle | None = None
        self._show(title)

    def update(self, times: Array, states: FleetSnapshot) -> None:
        """Draw the plot again. times: [s] (T,). states: state of the vehicle, with one row per time."""
        if self._choice.value != self._shown:
            self._show(self._choice.value)
        if self._chart is None:
            return
        self._chart.data = plot(BY_TITLE[self._shown], times, states, PLOT_WINDOW_S)

    def _show(self, title: str) -> None:
        if self._chart is not None:
            self._chart.remove()
            self._chart = None
        self._shown = title
        if title == NO_PLOT:
            return
        quantity = BY_TITLE[title]
        window = np.array([-PLOT_WINDOW_S, 0.0])
        with self._tab:
            self._chart = self._gui.add_uplot(
                (window, *(np.full(2, np.nan) for _ in quantity.lines), np.array([0.0, 1.0])),
                series(quantity),
                scales={"x": {"time": False}, "y": {"auto": True}},
                axes=axes(),
                height=_PLOT_HEIGHT,
                padding=(10, 12, 20, 0),
                legend={"show": True, "live": True},
                cursor={"show": True},
                order=self._order + 1.0,
            )


def series(quantity: Quantity) -> tuple[Any, ...]:
    """Return the description of a plot's lines for uPlot, the library that draws the plots.

    Only the last one, which is not drawn, sets the range of the axis: uPlot finds no range for a line that begins with NaN.
    """
    lines = [
        {
            "label": line.name,
            "stroke": _LINE_COLOURS[k % len(_LINE_COLOURS)],
            "width": 2 if line.name == "actual" else 1.5,
            "points": {"show": False},
            "auto": False,
        }
        for k, line in enumerate(quantity.lines)
    ]
    axis = {"label": "", "stroke": "transparent", "class": AXIS_CLASS, "points": {"show": False}}
    return ({"label": "time [s]"}, *lines, axis)


def axes() -> tuple[Any, ...]:
    """Return the description of a plot's axes (time and value) for uPlot, the library that draws the plots."""
    grid = {"stroke": "#2c3546", "width": 1}
    one = {"stroke": "#8b97ab", "grid": grid, "ticks": grid, "font": "11px system-ui", "size": 24}
    return (one, {**one, "size": 44})
