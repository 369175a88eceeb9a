"""Table rows about messages, poses and processes of a run. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from arena.report import errors
from arena.report.analysis import analyse
from arena.report.figures import Drawn
from arena.report.landings import flown_times
from arena.report.link_record import longest_gap, mean_rate
from arena.report.run_data import RunData


def link_row(one: Drawn, run: RunData) -> dict[str, Any]:
    """Return the table row of one vehicle's link: rates, longest gaps, and pose age."""
    link, flown = run.links.get(one.name), flown_times(one.flight)
    start, end = (float(one.t[flown[0][0]]), float(one.t[flown[-1][1]])) if flown else (-math.inf, math.inf)
    forward = run.stats(f"forward.{one.name}")
    recorded = run.stats("recorder").get("vehicles", {}).get(one.name) or run.stats(f"logger.{one.name}")
    row: dict[str, Any] = {
        "name": one.name,
        "colour": one.colour,
        "forward_hz": forward.get("rate_hz"),
        "log_hz": analyse(one.flight)["log_hz"],
    }
    row |= {
        "dropped": _dropped(forward),
        "up_hz": None,
        "down_gap": None,
        "pose_gap": None,
        "vision_gap": None,
        "age": None,
    }
    if link is None:
        return {**row, "down_hz": recorded.get("datagrams_hz"), "pose_hz": recorded.get("mocap_hz")}
    ages = 1e3 * link.pose_age_s
    return {
        **row,
        "down_hz": mean_rate(link.down_s),
        "up_hz": mean_rate(link.up_s),
        "pose_hz": mean_rate(link.pose_s),
        "down_gap": longest_gap(link.down_s, start, end),
        "pose_gap": longest_gap(link.pose_s, start, end),
        "vision_gap": longest_gap(link.vision_s, start, end),
        "age": errors.measures(link.pose_s, ages),
    }


def _dropped(stats: Mapping[str, Any]) -> str:
    """Return how many frames and messages a pose forwarder has dropped, for each reason."""
    found = {
        key.removeprefix("dropped "): value
        for key, value in stats.items()
        if key.startswith("dropped ") and value
    }
    return ", ".join(f"{value} {_DROPPED.get(key, key)}" for key, value in found.items())


_DROPPED = {
    "untracked": "poses not tracked",
    "held for the origin": "poses while the autopilot had no origin",
    "superseded": "poses older than another pose",
    "repeated frame": "repeated frames",
    "stale": "poses too old",
    "no pose": "without a valid pose",
    "foreign message": "MAVLink messages of other senders on its link, ignored",
}


def _end_words(row: Mapping[str, Any]) -> str:
    """Return how a process ended, such as `exit 1` or `ended (SIGTERM from arena, normal)`.

    row: its entry in outcome.json.
    """
    end, reason = str(row.get("exit") or ""), str(row.get("reason") or "")
    signal = end.removeprefix("killed by ")
    if signal in ("SIGTERM", "SIGINT") and "the run ends" in reason:
        return f"ended ({signal} from arena, normal)"
    return end or reason or str(row.get("state") or "")


def process_rows(run: RunData) -> list[dict[str, Any]]:
    rows = []
    for name, row in run.outcome.get("processes", {}).items():
        rows.append(
            {
                "name": name,
                "member_of": row.get("member_of", ""),
                "cpu": None if row.get("cpu_mean") is None else 100.0 * row["cpu_mean"],
                "cpu_s": row.get("cpu_s"),
                "memory": row.get("rss_peak_mb"),
                "starts": row.get("starts"),
                "end": _end_words(row),
                "over": ", ".join(map(str, row.get("over_budget") or ())),
            }
        )
    return rows
