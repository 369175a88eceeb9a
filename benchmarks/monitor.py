"""Pictures per second of the monitor's page in a browser, and what a picture costs. Run: `python benchmarks/monitor.py --vehicles 200`.

Invented vehicles fly circles. The page is served by a process of its own, as `arena monitor` does; a Chromium without a screen shows it.
Chromium's own trace reports for each thread how much CPU time a picture needs: the main thread runs JavaScript, the GPU process draws in
software (SwiftShader), which a GPU would do. With `--software-compositing` only the 3D picture is drawn by SwiftShader, and the page
around it by the browser's own software compositor.
With `--no-draw` all WebGL draw calls are left out: the rest is what a GPU cannot take over.
"""

from __future__ import annotations

import argparse
import asyncio
import dataclasses
import json
import multiprocessing
import os
import resource
import shutil
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "monitor"))
from fleets import snapshot

from arena.geometry import quat_from_euler
from arena.live_view import Snapshot
from arena.monitor.access import access_for
from arena.monitor.page import show
from arena.monitor.server import free_port, open_server

ROOM_M = (60.0, 60.0, 12.0)
SPACING_M = 3.0
_COUNT = """
() => {
  window.__pictures = 0; window.__updates = 0; window.__no_draw = NO_DRAW;
  for (const kind of [WebGL2RenderingContext]) {
    for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"]) {
      const inner = kind.prototype[name];
      kind.prototype[name] = function (...a) {
        window.__draws = (window.__draws || 0) + 1;
        if (!window.__no_draw) return inner.apply(this, a);
      };
    }
    const clear = kind.prototype.clear;
    kind.prototype.clear = function (...a) { window.__clears = (window.__clears || 0) + 1; return clear.apply(this, a); };
  }
  const tick = () => { window.__pictures += 1; requestAnimationFrame(tick); };
  requestAnimationFrame(tick);
}
"""


class CirclesFeed:
    """Source of invented states. vehicles: their number."""

    def __init__(self, vehicles: int) -> None:
        self.waiting_for = ""
        base = snapshot(vehicles)
        side = int(np.ceil(np.sqrt(vehicles)))
        k = np.arange(vehicles)
        self._centre = (
            np.stack([k // side - side / 2, k % side - side / 2, np.zeros(vehicles)], axis=1) * SPACING_M
        )
        starts = [
            dataclasses.replace(v, start_n=tuple(float(x) for x in p))
            for v, p in zip(base.settings.vehicles, self._centre, strict=True)
        ]
        self._base = dataclasses.replace(
            base, settings=dataclasses.replace(base.settings, size_m=ROOM_M, vehicles=tuple(starts))
        )
        self._phase = 0.37 * k
        self._began = time.monotonic()

    def poll(self, now: float | None = None) -> Snapshot:
        t = time.monotonic() - self._began
        angle = 0.8 * t + self._phase
        around = np.stack([np.cos(angle), np.sin(angle), -2.0 - 0.5 * np.sin(0.5 * angle)], axis=1)
        rpy = np.stack([0.1 * np.sin(angle), 0.1 * np.cos(angle), angle], axis=1)
        p_n, q_nb = self._centre + around, quat_from_euler(rpy)
        fleet = dataclasses.replace(
            self._base.fleet, p_n=p_n, est_p_n=p_n, set_p_n=p_n + 0.05, q_nb=q_nb, est_q_nb=q_nb
        )
        return dataclasses.replace(self._base, time_s=t, fleet=fleet)


def serve(vehicles: int, pipe: Any) -> None:
    """Serve the page of invented vehicles. Send its URL, then at each request the CPU time of this process [s]."""
    access = access_for("127.0.0.1", free_port("127.0.0.1", 0))
    server = open_server(access)
    asyncio.run_coroutine_threadsafe(show(server, CirclesFeed(vehicles)), server.get_event_loop())
    pipe.send(access.url)
    while pipe.recv():
        used = resource.getrusage(resource.RUSAGE_SELF)
        pipe.send(used.ru_utime + used.ru_stime)


def threads_of(tree: int) -> dict[str, float]:
    """Return CPU time [s] of the threads below a process, by kind of process and name of the thread."""
    children: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        children.setdefault(parent, []).append(int(path.parent.name))
    found: dict[str, float] = {}
    todo = [tree]
    while todo:
        pid = todo.pop()
        todo += children.get(pid, [])
        try:
            words = Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").split()
            kind = next((w[7:].decode() for w in words if w.startswith(b"--type=")), "browser")
            for task in Path(f"/proc/{pid}/task").iterdir():
                head, _, rest = (task / "stat").read_text().rpartition(")")
                used = sum(int(x) for x in rest.split()[11:13]) / os.sysconf("SC_CLK_TCK")
                name = f"{kind}:{head.partition('(')[2]}"
                found[name] = found.get(name, 0.0) + used
        except OSError:
            continue
    return found


def measure(
    vehicles: int,
    width: int,
    height: int,
    seconds: float,
    *,
    no_draw: bool,
    software_compositing: bool,
    shot: str,
    profile: str,
) -> None:
    from playwright.sync_api import sync_playwright

    ours, theirs = multiprocessing.get_context("fork").Pipe()
    process = multiprocessing.get_context("fork").Process(target=serve, args=(vehicles, theirs), daemon=True)
    process.start()
    url = ours.recv()
    flags = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    flags += ["--disable-gpu-compositing"] if software_compositing else []
    with sync_playwright() as playwright:
        path = shutil.which("chromium")
        browser = playwright.chromium.launch(executable_path=path, args=flags)
        page = browser.new_page(viewport={"width": width, "height": height})
        page.add_init_script(f"({_COUNT.replace('NO_DRAW', 'true' if no_draw else 'false')})()")
        page.goto(url)
        page.wait_for_function("document.body.innerText.includes('uav1')", timeout=60_000)
        page.wait_for_timeout(10_000)
        session = page.context.new_cdp_session(page)
        session.send("Performance.enable")
        if profile:
            session.send("Profiler.enable")
            session.send("Profiler.start")
        before = counted(page, session, ours)
        page.wait_for_timeout(1000.0 * seconds)
        after = counted(page, session, ours)
        if profile:
            Path(profile).write_text(json.dumps(session.send("Profiler.stop")["profile"]))
        if shot:
            page.screenshot(path=shot, timeout=120_000)
        browser.close()
    ours.send(False)
    process.join(10)
    report(before, after, vehicles, width, height)


def counted(page: Any, session: Any, pipe: Any) -> dict[str, Any]:
    pipe.send(True)
    metrics = {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}
    return {
        "time": time.monotonic(),
        "server": pipe.recv(),
        "canvas": page.evaluate("[...document.querySelectorAll('canvas')].map(c => [c.width, c.height])"),
        "page": page.evaluate("[window.__pictures, window.__draws || 0, window.__clears || 0]"),
        "metrics": metrics,
        "threads": threads_of(os.getpid()),
    }


def report(before: dict[str, Any], after: dict[str, Any], vehicles: int, width: int, height: int) -> None:
    span = after["time"] - before["time"]
    pictures, draws, clears = (b - a for a, b in zip(before["page"], after["page"], strict=True))
    canvas = max(after["canvas"], key=lambda c: c[0] * c[1])
    print(
        f"{vehicles} vehicles, page of {width} x {height} px, 3D picture of {canvas[0]} x {canvas[1]} px, {span:.1f} s"
    )
    each = max(pictures, 1)
    print(
        f"  {pictures / span:.2f} pictures/s, {draws / each:.0f} draw calls and {clears / each:.1f} clears per picture"
    )
    print(f"  server: {100 * (after['server'] - before['server']) / span:.1f} % of a core")
    for name in ("ScriptDuration", "LayoutDuration", "RecalcStyleDuration", "TaskDuration"):
        used = after["metrics"][name] - before["metrics"][name]
        print(
            f"  main thread, {name}: {1e3 * used / max(pictures, 1):.1f} ms per picture, {100 * used / span:.0f} % of a core"
        )
    for name, end in sorted(after["threads"].items(), key=lambda p: before["threads"].get(p[0], 0.0) - p[1])[
        :12
    ]:
        used = end - before["threads"].get(name, 0.0)
        if used > 0.01 * span:
            print(
                f"  thread {name}: {1e3 * used / max(pictures, 1):.1f} ms per picture, {100 * used / span:.0f} % of a core"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--vehicles", type=int, default=200)
    parser.add_argument("--size", default="640x360", help="of the page [px]")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--no-draw", action="store_true", help="leave out the WebGL draw calls")
    parser.add_argument(
        "--software-compositing",
        action="store_true",
        help="draw the page around the 3D picture without WebGL",
    )
    parser.add_argument("--screenshot", default="", help="PNG file")
    parser.add_argument("--profile", default="", help="file for a CPU profile of the main thread")
    given = parser.parse_args()
    width, height = (int(x) for x in given.size.split("x"))
    measure(
        given.vehicles,
        width,
        height,
        given.seconds,
        no_draw=given.no_draw,
        software_compositing=given.software_compositing,
        shot=given.screenshot,
        profile=given.profile,
    )


if __name__ == "__main__":
    main()
