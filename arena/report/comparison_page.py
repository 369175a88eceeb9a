"""HTML page that compares two flights: curves on one time axis, differences, and a table of measures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from arena.errors import InputError
from arena.flight_log.flight import Flight
from arena.flight_log.open import read_flights
from arena.report import attitude_figure, errors, figures, overview_figures, velocity_battery_figures
from arena.report.figures import Curve, Drawn, Figure, Panel, over_time
from arena.report.flight_pair import Difference, Moment, Pair, difference, pairs
from arena.report.html_page import render
from arena.report.pair_figures import pair_figures

_COLOUR_A, _COLOUR_B = "#0072b2", "#d55e00"
_MOST_CHANGES = 60
_MOMENT_WORDS = {
    "step": "its first setpoint more than 0.1 m away from the place where OFFBOARD began",
    "offboard": "its entry into OFFBOARD",
    "takeoff": "its take-off",
}


@dataclass(frozen=True, kw_only=True)
class Source:
    """Flights of a run folder or log file that a comparison reads, and the settings of their run.

    name: name of the folder or file, for the page.
    settings: key of the YAML -> value, {} if unknown.
    """

    name: str
    flights: Sequence[Flight]
    settings: Mapping[str, str]


def read_source(text: str) -> Source:
    """Read the flights of a command-line argument `PATH` or `PATH:VEHICLE`.

    PATH: run folder, or log of any supported format.

    Raises InputError if the path cannot be read, or contains no such vehicle.
    """
    path, vehicle = Path(text), ""
    if not path.exists() and ":" in text:
        head, _, vehicle = text.rpartition(":")
        path = Path(head)
    flights = read_flights(path)
    if vehicle:
        known = ", ".join(flight.name for flight in flights)
        flights = [flight for flight in flights if flight.name == vehicle]
        if not flights:
            raise InputError(f"{path}: got the vehicle {vehicle!r}, expected one of: {known}")
    name = path.resolve().name if path.is_dir() else path.stem
    return Source(name=name, flights=flights, settings=_settings(path / "arena.yaml"))


def _settings(path: Path) -> dict[str, str]:
    """Return the settings in a resolved arena.yaml as dotted key -> text. Return {} if the file cannot be read."""
    try:
        found = yaml.safe_load(path.read_text())
    except (OSError, ValueError, yaml.YAMLError):
        return {}
    return dict(_flat(found, ""))


def _flat(node: Any, key: str) -> list[tuple[str, str]]:
    if isinstance(node, dict):
        return [
            pair
            for name, value in node.items()
            for pair in _flat(value, f"{key}.{name}" if key else str(name))
        ]
    return [(key, "not set" if node is None else str(node).lower() if isinstance(node, bool) else str(node))]


def comparison_page(a: Source, b: Source, moment: Moment | None = None) -> str:
    """Return the HTML page that compares two sources of flights.

    Raises InputError if a source has no flights to compare.
    """
    found = pairs(a.flights, b.flights, (a.name, b.name), moment)
    differences = {pair.name: difference(pair) for pair in found}
    vehicles = [one for pair in found for one in _drawn(pair, len(found))]
    made = _figures(found, vehicles, differences)
    content = {
        "made": made,
        "title": f"{a.name} and {b.name}",
        "names": (a.name, b.name),
        "colours": (_COLOUR_A, _COLOUR_B),
        "verdicts": [_verdict(pair, differences[pair.name]) for pair in found],
        "pairs": [_pair_content(pair, differences[pair.name]) for pair in found],
        "moment": _MOMENT_WORDS[found[0].moment] if found else "",
        "vehicles": [{"name": pair.name, "colour": figures.GREY} for pair in found] if len(found) > 1 else [],
        "changes": _changes(a.settings, b.settings),
        "left_out": [f.name for f in (*a.flights, *b.flights) if not any(_in(f, pair) for pair in found)],
    }
    return render("comparison.html", content, made, _options(found, vehicles))


def _in(flight: Flight, pair: Pair) -> bool:
    return any(flight.name == side.flight.name and flight.t0 == side.flight.t0 for side in (pair.a, pair.b))


def _drawn(pair: Pair, count: int) -> list[Drawn]:
    most = max(figures.LEAST_POINTS, figures.MAX_POINTS // (20 * count))
    return [
        Drawn(
            name=side.label, flight=side.flight, t=side.t, rows=figures.thinned(side.flight, most), colour=colour, chip=pair.name
        )
        for side, colour in ((pair.a, _COLOUR_A), (pair.b, _COLOUR_B))
    ]  # fmt: skip


def _figures(
    found: Sequence[Pair], vehicles: Sequence[Drawn], differences: Mapping[str, Difference]
) -> dict[str, Figure]:
    made = {
        "map": overview_figures.map_3d(vehicles, None),
        "difference": difference_figure(found, differences),
        "position": figures.position(vehicles),
        "tracking": errors.tracking_figure(vehicles),
        "estimator": errors.estimator_figure(vehicles),
        "attitude": attitude_figure.attitude(vehicles),
        "velocity": velocity_battery_figures.velocity(vehicles),
    }
    return {name: figure for name, figure in made.items() if figure["data"]}


def difference_figure(found: Sequence[Pair], differences: Mapping[str, Difference]) -> Figure:
    """Return the figure of the difference B minus A: distance, north, east, up and yaw."""
    columns = [
        ("distance [m]", lambda d: np.linalg.norm(d.position, axis=1)),
        ("north [m]", lambda d: d.position[:, 0]),
        ("east [m]", lambda d: d.position[:, 1]),
        ("up [m]", lambda d: -d.position[:, 2]),
        ("yaw [deg]", lambda d: d.yaw),
    ]
    drawn = []
    for pair in found:
        d = differences[pair.name]
        step = max(1, d.t.size // 4000)
        drawn.append(
            Drawn(
                name="B minus A",
                flight=pair.a.flight,
                t=d.t,
                rows=np.arange(0, d.t.size, step),
                colour="#6a3d9a",
                chip=pair.name,
            )
        )
    by_chip = {one.chip: one for one in drawn}

    def curve(title: str, values: Any) -> Panel:
        def of(one: Drawn) -> Any:
            return values(differences[one.chip])

        return Panel(
            title=title, curves=[Curve(label="", values=of, width=1.4)], zero=title.startswith("distance")
        )

    return over_time(list(by_chip.values()), [curve(*column) for column in columns], height=105, legend=False)


def _options(found: Sequence[Pair], vehicles: Sequence[Drawn]) -> dict[str, Any]:
    first = min((max(-3.0, float(one.t[0])) for one in vehicles), default=0.0)
    last = max((float(one.t[-1]) for one in vehicles), default=1.0)
    names = [{"name": pair.name, "colour": figures.GREY} for pair in found]
    return {
        "time": [first, last],
        "vehicles": names,
        "preferred": names[0]["name"] if names else "",
        "marks": [],
        "detailAll": 1,
    }


def _verdict(pair: Pair, d: Difference) -> str:
    found = d.measures()["distance"]
    a, b = (
        errors.measures(side.t, errors.norm(errors.tracking_error(side.flight))) for side in (pair.a, pair.b)
    )
    text = f"{pair.a.label} and {pair.b.label}"
    text += (
        f" were {found.rms:.2f} m apart (rms), at most {found.max:.2f} m"
        if found
        else " have no positions in common"
    )
    if a and b:
        text += f"; tracking error {a.rms:.3f} m (rms) in A, {b.rms:.3f} m in B"
        text += f" ({_change(a.rms, b.rms)})" if a.rms > 0.0 else ""
    return text


def _pair_content(pair: Pair, d: Difference) -> dict[str, Any]:
    """Return the tables of one pair of flights: measures of the difference, and measures of both flights."""
    return {
        "name": pair.name,
        "labels": (pair.a.label, pair.b.label),
        "lasted": float(d.t[-1] - d.t[0]),
        "zeros": (pair.a.zero_s, pair.b.zero_s),
        "starts": (pair.a.p_n.tolist(), pair.b.p_n.tolist()),
        "difference": list(d.measures().items()),
        "rows": [
            (label, unit, digits, a, b, _change(a, b)) for label, unit, digits, a, b in pair_figures(pair)
        ],
    }


def _change(a: float | None, b: float | None) -> str:
    """Return the change from A to B as text, such as `+12 %`. Return "" if it is unknown.

    Large changes, of a factor of 10 or more, are stated as a factor.
    """
    if not a or b is None:
        return ""
    if b / a >= 10.0:
        return f"{b / a:.0f} times as large"
    percent = round(100.0 * (b / a - 1.0))
    return f"{percent:+d} %" if percent else "0 %"


def _changes(a: Mapping[str, str], b: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """Return (key, value of A, value of B) for each setting that differs.

    The list is empty if the settings of one source are unknown.

    A vehicle of only one run is one row.
    """
    if not a or not b:
        return []
    in_a, in_b = _vehicle_names(a), _vehicle_names(b)
    alone = in_a ^ in_b
    words = {True: "in this run", False: "not in this run"}
    rows = [(f"vehicles.{name}", words[name in in_a], words[name in in_b]) for name in sorted(alone)]
    keys = [key for key in {**a, **b} if not alone & _vehicle_names([key])]
    changed = [(key, a.get(key, "not set"), b.get(key, "not set")) for key in keys]
    return [*(row for row in changed if row[1] != row[2]), *rows][:_MOST_CHANGES]


def _vehicle_names(keys: Iterable[str]) -> set[str]:
    """Return the vehicle names that occur in setting keys such as `vehicles.uav1.port`."""
    return {key.split(".")[1] for key in keys if key.startswith("vehicles.")}
