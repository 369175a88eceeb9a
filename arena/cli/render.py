"""`arena render RUN`: make a film or a picture of a recorded flight, without a screen."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from arena.cli.runs import last_run
from arena.errors import InputError

if TYPE_CHECKING:
    from arena.render.film import Progress

_SIZES = {".mp4": (1280, 720), ".gif": (640, 360), ".png": (1600, 900)}
_FPS = {".mp4": 30.0, ".gif": 12.5, ".png": 1.0}
_TRAIL_S = 5.0
_SIDE_PX = (64, 7680)


def register(app: typer.Typer) -> None:
    """Add the command `arena render` to the typer app."""

    @app.command()
    def render(  # noqa: PLR0913, PLR0917 - one argument per option
        runs: Annotated[
            list[Path],
            typer.Argument(
                metavar="RUN...",
                help="run folder, log file (flight.mcap, CSV, ULog), or folder of an arena, for its last run",
            ),
        ],
        output: Annotated[
            Path | None,
            typer.Option(
                "-o",
                "--output",
                metavar="FILE",
                help="file to write: .mp4, .gif or .png; default: film.mp4 in the run folder",
            ),
        ] = None,
        start_s: Annotated[
            float | None,
            typer.Option(
                "--from", metavar="T", help="start [s] of the film; default: 1 s before the first arming"
            ),
        ] = None,
        end_s: Annotated[
            float | None,
            typer.Option(
                "--to", metavar="T", help="end [s] of the film; default: 1.5 s after the last disarming"
            ),
        ] = None,
        speed: Annotated[
            float,
            typer.Option(
                metavar="X", min=0.01, max=1000.0, help="speed: seconds of flight per second of film"
            ),
        ] = 1.0,
        size: Annotated[
            str,
            typer.Option(
                metavar="WxH",
                help="width and height [px]; default: 1280x720, for gif 640x360, for png 1600x900",
            ),
        ] = "",
        fps: Annotated[
            float | None,
            typer.Option(
                metavar="N", min=1.0, max=60.0, help="pictures per second of film; default: 30, for gif 12.5"
            ),
        ] = None,
        camera: Annotated[
            str,
            typer.Option(
                metavar="VIEW",
                help="camera: corner, north, east, south, west, top, orbit, follow:VEHICLE, or AZIMUTH,ELEVATION [deg] from the room "
                "to the camera",
            ),
        ] = "corner",
        vehicle: Annotated[
            list[str] | None,
            typer.Option(metavar="NAME", help="show only this vehicle; may be given several times"),
        ] = None,
        trail_s: Annotated[
            float,
            typer.Option(
                "--trail",
                metavar="S",
                min=0.0,
                max=3600.0,
                help="length of the trail behind each vehicle [s]",
            ),
        ] = _TRAIL_S,
        jobs: Annotated[
            int | None,
            typer.Option(
                "-j",
                "--jobs",
                metavar="N",
                min=1,
                help="number of processes that draw; default: number of CPU cores",
            ),
        ] = None,
    ) -> None:
        """Make a film (mp4, gif) or a picture (png) of a recorded flight. Needs no screen."""
        from arena.render.film import check_output, cores, write_film, write_picture
        from arena.render.script import make_script, picture_times, whole_flight
        from arena.render.sources import load
        from arena.render.tracks import flown_span
        from arena.render.views import parse_view

        began = time.monotonic()
        paths = [_recorded_run(path) for path in runs]
        file = output or (paths[0] if paths[0].is_dir() else Path()) / "film.mp4"
        check_output(file)
        view, pixels = parse_view(camera), _size(size, file.suffix)
        recorded = load(paths, vehicle or ())
        first, last = flown_span(recorded.tracks)
        start, end = first if start_s is None else start_s, last if end_s is None else end_s
        if file.suffix == ".png" and (start_s is None or end_s is not None):
            _check_span(start, end)
            write_picture(whole_flight(recorded, start, end, view, pixels), file)
        elif file.suffix == ".png":
            times = picture_times(start, start, 1.0, 1.0)
            script = make_script(recorded, times, view, pixels, speed=1.0, trail_s=trail_s)
            write_picture(script.picture(0), file)
        else:
            _check_span(start, end)
            rate = fps or _FPS[file.suffix]
            script = make_script(
                recorded, picture_times(start, end, rate, speed), view, pixels, speed=speed, trail_s=trail_s
            )
            with _progress_line() as progress:
                write_film(script, file, fps=rate, jobs=jobs or cores(), progress=progress)
        kind, took = "picture" if file.suffix == ".png" else "film", time.monotonic() - began
        print(f"{kind}: {file} ({_file_size(file)}, {pixels[0]} x {pixels[1]} px, made in {took:.1f} s)")


def _recorded_run(path: Path) -> Path:
    """Return the run folder or log file to draw. For an arena's folder, return its newest run folder."""
    if not path.exists():
        raise InputError(f"{path}: does not exist. `arena runs` lists run folders")
    return last_run(path)


def _size(text: str, kind: str) -> tuple[int, int]:
    """Return (width, height) [px] of a text such as `1280x720`, rounded down to even numbers for mp4."""
    if not text:
        return _SIZES[kind]
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    sides = (int(match[1]), int(match[2])) if match else (0, 0)
    if not all(_SIDE_PX[0] <= side <= _SIDE_PX[1] for side in sides):
        raise InputError(
            f"--size {text}: expected width and height from {_SIDE_PX[0]} to {_SIDE_PX[1]} px, such as 1280x720"
        )
    return sides[0] // 2 * 2, sides[1] // 2 * 2


def _check_span(start_s: float, end_s: float) -> None:
    if not start_s < end_s:
        raise InputError(
            f"the film would end at {end_s:g} s, before it starts at {start_s:g} s: change --from or --to"
        )


@contextmanager
def _progress_line() -> Iterator[Progress]:
    """Show the number of drawn pictures and the remaining time on the terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("drawing"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("pictures"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        task = shown.add_task("", total=None)
        show: Callable[[int, int], None] = lambda done, total: shown.update(task, completed=done, total=total)  # noqa: E731
        yield show


def _file_size(file: Path) -> str:
    count = file.stat().st_size
    return f"{count / 1e6:.1f} MB" if count >= 1e5 else f"{count / 1e3:.0f} kB"
