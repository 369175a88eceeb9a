"""Draws the pictures of a film in several processes and writes them to a file (mp4, gif or png)."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from arena.errors import InputError, NotInstalledError, RunError
from arena.render import style
from arena.render.script import Script

KINDS = (".mp4", ".gif", ".png")
_AHEAD = 4  # pictures per worker that may wait for the file
_PALETTE_PICTURES = 9
_ROOM_COLOURS, _VIVID_COLOURS = 72, 180
_VIVID = 48  # difference of the largest and the smallest of red, green and blue
_CRF = "21"  # quality of x264: smaller is better
Progress = Callable[[int, int], None]
"""Called with the number of written pictures and the number of all pictures."""


def write_film(script: Script, file: Path, *, fps: float, jobs: int, progress: Progress) -> None:
    """Draw all pictures of a film and write them to an .mp4 or .gif file.

    An existing file of this name is replaced when the new file is complete.

    fps: pictures per second of film.  jobs: number of processes that draw.
    Raises NotInstalledError if the package that writes mp4 is missing, and RunError if the file cannot be written.
    """
    draft = file.with_name(f".{file.stem}.part{file.suffix}")
    try:
        if file.suffix == ".gif":
            _write_gif(script, draft, fps, jobs, progress)
        else:
            _write_mp4(script, draft, fps, jobs, progress)
        draft.replace(file)
    except OSError as error:
        raise RunError(f"{file}: could not be written: {error}") from error
    finally:
        with contextlib.suppress(OSError):
            draft.unlink(missing_ok=True)


def write_picture(picture: Image.Image, file: Path) -> None:
    """Write one picture as png. Raises RunError if the file cannot be written."""
    try:
        picture.save(file)
    except OSError as error:
        raise RunError(f"{file}: could not be written: {error}") from error


def check_output(file: Path) -> None:
    """Check the output file of `arena render` before drawing begins.

    Raises InputError if the file ending is not supported or the folder does not exist.
    Raises NotInstalledError if the package that writes the format is missing.
    """
    if file.suffix not in KINDS:
        raise InputError(f"-o {file}: expected a file name that ends with {', '.join(KINDS)}")
    if not file.parent.is_dir():
        raise InputError(f"-o {file}: the folder {file.parent} does not exist")
    if file.suffix == ".mp4":
        _ffmpeg()


def _ffmpeg() -> Any:
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise NotInstalledError(
            "writing mp4 files needs the package imageio-ffmpeg, which contains ffmpeg: pip install 'flying-arena[render]'."
            " It is not needed for .gif and .png files"
        ) from error
    return imageio_ffmpeg


def pictures(
    script: Script, numbers: Sequence[int], jobs: int, palette: Image.Image | None = None
) -> Iterator[bytes]:
    """Draw pictures in several processes and yield them in order.

    jobs: number of processes.
    Each picture has RGB values, or indices of `palette`, row by row.
    """
    if jobs <= 1 or len(numbers) < 2 * jobs:
        _start(script, palette)
        yield from map(_draw, numbers)
        return
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(jobs, context, _start_worker, (script, palette)) as pool:
        waiting: deque[Future[bytes]] = deque()
        try:
            for k in numbers:
                waiting.append(pool.submit(_draw, k))
                if len(waiting) >= _AHEAD * jobs:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


_current: list[tuple[Script, Image.Image | None]] = []  # of this worker process


def _start(script: Script, palette: Image.Image | None) -> None:
    _current[:] = [(script, palette)]


def _start_worker(script: Script, palette: Image.Image | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the main process, which then ends its workers
    _start(script, palette)


def _draw(k: int) -> bytes:
    script, palette = _current[0]
    picture = script.picture(k)
    return picture.tobytes() if palette is None else _reduced(picture, palette).tobytes()


def _reduced(picture: Image.Image, palette: Image.Image) -> Image.Image:
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)


def _write_mp4(script: Script, file: Path, fps: float, jobs: int, progress: Progress) -> None:
    size = (script.cameras[0].width, script.cameras[0].height)
    total = len(script.times)
    drawn = pictures(script, range(total), jobs)
    first = next(drawn)  # the workers start before ffmpeg, because they would keep its pipe open
    writer = _ffmpeg().write_frames(
        str(file),
        size,
        fps=fps,
        codec="libx264",
        quality=None,
        macro_block_size=2,
        ffmpeg_log_level="error",
        output_params=["-crf", _CRF, "-preset", "veryfast", "-movflags", "+faststart", "-threads", "1"],
    )
    with contextlib.closing(writer):
        writer.send(None)
        writer.send(first)
        progress(1, total)
        for done, picture in enumerate(drawn, start=2):
            writer.send(picture)
            progress(done, total)


def _write_gif(script: Script, file: Path, fps: float, jobs: int, progress: Progress) -> None:
    size, total = (script.cameras[0].width, script.cameras[0].height), len(script.times)
    palette = _palette(script)

    def read() -> Iterator[Image.Image]:
        for done, data in enumerate(pictures(script, range(total), jobs, palette), start=1):
            progress(done, total)
            picture = Image.frombytes("P", size, data)
            picture.putpalette(palette.getpalette() or [])
            yield picture

    images = read()
    # Times in a GIF are hundredths of a second.
    next(images).save(
        file,
        save_all=True,
        append_images=images,
        duration=10 * max(2, round(100 / fps)),
        loop=0,
        optimize=True,
        disposal=1,
    )


def _palette(script: Script) -> Image.Image:
    """Return an image with one common colour palette for a whole film.

    It is made from some of the pictures. One palette keeps the file small.

    Vivid colours are few pixels, so they get their own part of the palette. Else the grey room would use all of it.
    """
    total = len(script.times)
    some = sorted({round(k * (total - 1) / (_PALETTE_PICTURES - 1)) for k in range(_PALETTE_PICTURES)})
    pixels = np.concatenate([np.asarray(script.picture(k)).reshape(-1, 3) for k in some])
    vivid = np.ptp(pixels.astype(np.int16), axis=1) > _VIVID
    texts = [*style.TEXT, *style.TEXT_DIM]
    colours = (
        texts + _main_colours(pixels[~vivid], _ROOM_COLOURS) + _main_colours(pixels[vivid], _VIVID_COLOURS)
    )
    palette = Image.new("P", (1, 1))
    palette.putpalette(colours)
    return palette


def _main_colours(pixels: NDArray[np.uint8], count: int) -> list[int]:
    """Return at most `count` colours that together represent the given pixels (n, 3) best.

    The result is a list r, g, b, r, g, b, ...
    """
    if not len(pixels):
        return []
    line = Image.fromarray(np.ascontiguousarray(pixels)[None])
    reduced = line.quantize(count, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    return (reduced.getpalette() or [])[: 3 * count]


def cores() -> int:
    """Return the number of CPU cores that this process may use."""
    return len(os.sched_getaffinity(0))
