"""Formats the summary of a run as text for a terminal. Reads and writes no files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SLOW_FACTOR = 0.98
"""Fraction of the requested speed below which the simulation counts as too slow."""


def as_text(summary: Mapping[str, Any]) -> str:
    """Return the text of summary.txt, the summary of a run.

    summary: object that `report.summarise` has returned.
    """
    lines = [
        _head(summary),
        *_real_time(summary),
        *_vehicles(summary["vehicles"]),
        *_px4(summary.get("px4") or {}),
        *_world(summary),
    ]
    lines += _processes(summary["processes"])
    lines += [f"missing: {what}" for what in summary["missing"]]
    return "\n".join(lines)


def _head(s: Mapping[str, Any]) -> str:
    if s.get("exit_code") is None:
        return "no outcome was recorded: the supervisor was killed, or could not write it"
    ended = f"exit {s['exit_code']}" + (f": {'; '.join(s['failed'])}" if s.get("failed") else "")
    return f"{s['name']}: {_n(s['duration_s'], 1)} s, ended because {s['reason'] or s['cause']}, {ended}"


def _real_time(s: Mapping[str, Any]) -> list[str]:
    """Return one warning line in a list if the simulation was slower than requested, else an empty list."""
    measured = s.get("real_time") or {}
    factor, asked = measured.get("factor"), measured.get("asked")
    if factor is None or asked is None or factor >= SLOW_FACTOR * asked:
        return []
    return [
        f"SLOWER THAN REQUESTED: {factor:.2f} simulated seconds per second, {asked:g} was requested:"
        " results that depend on wall time do not hold"
    ]


def _vehicles(vehicles: Mapping[str, Any]) -> list[str]:
    head = (
        "vehicle",
        "took off",
        "setpoints",
        "worst",
        "tracking",
        "landing",
        "estimate",
        "yaw",
        "log",
        "judged",
        "verdict",
    )
    units = ("", "at s", "", "end, m", "rms m", "error m", "rms/max m", "rms/max deg", "Hz", "by", "")
    rows = [_vehicle(name, v) for name, v in vehicles.items()]
    table = _table([head, units, *rows])
    timelines = [f"  {name}: {_timeline(v['modes'])}" for name, v in vehicles.items() if v.get("modes")]
    return [*table, *timelines]


def _vehicle(name: str, v: Mapping[str, Any]) -> tuple[str, ...]:
    if "tracking" not in v:
        return (name, *["-"] * 9, "no log" + (f", crashed: {v['crashed']}" if v.get("crashed") else ""))
    est, land = v["estimator"], v["landing"]
    verdict = "landed" if land["landed"] and v["flown"] else "NOT landed" if v["flown"] else "not flown"
    verdict = "log ends before its flight" if v.get("log_ends_early") else verdict
    verdict = f"crashed: {v['crashed']}" if v.get("crashed") else verdict
    return (
        name,
        _n(v["took_off_s"], 1),
        str(v["setpoints"]["count"]),
        _n(v["setpoints"]["worst_m"], 3),
        _n(v["tracking"]["rms_m"], 3),
        _n(land["error_m"], 3),
        f"{_n(est['pos_rms_m'], 4)}/{_n(est['pos_max_m'], 4)}",
        f"{_n(est['yaw_rms_deg'], 2)}/{_n(est['yaw_max_deg'], 2)}",
        _n(v["log_hz"], 1),
        v["judged_by"],
        verdict,
    )


def _timeline(modes: list[Mapping[str, Any]]) -> str:
    shown = modes if len(modes) <= 12 else [*modes[:11], modes[-1]]
    return "  ".join(f"{_n(m['t_s'], 1)} s {m['mode'] or '?'}{' armed' if m['armed'] else ''}" for m in shown)


def _px4(vehicles: Mapping[str, Any]) -> list[str]:
    lines = []
    for name, p in vehicles.items():
        what = "arena's stand-in for PX4" if p["stand_in"] else f"PX4 {p['version']}".rstrip()
        ended = f" ENDED BY ITSELF ({p['ended']})" if p["ended"] else ""
        lines.append(f"{name}: {what}{ended}; ULogs: {', '.join(p['ulogs']) or 'none'}")
    return lines


def _world(s: Mapping[str, Any]) -> list[str]:
    w = s["world"]
    if w.get("lateness_p99_ms") is None:
        return []
    measured = s.get("real_time") or {}
    if measured.get("factor") is not None and measured.get("asked") is None:
        factors = f"real-time factor {_n(w['rtf_min'], 3)} to {_n(w['rtf_max'], 3)} in each second"
        return [f"world: as fast as possible, without a clock; {factors}"]
    late = f"step lateness p99 {_n(w['lateness_p99_ms'], 2)} ms, worst {_n(w['lateness_worst_ms'], 2)} ms"
    return [f"world: {late}; real-time factor {_n(w['rtf_min'], 3)} to {_n(w['rtf_max'], 3)} in each second"]


def _processes(processes: Mapping[str, Any]) -> list[str]:
    rows = [
        (
            name,
            f"{100 * (p['cpu_mean'] or 0.0):.1f}",
            f"{p['rss_peak_mb'] or 0.0:.0f}",
            str(p["starts"] or 0),
            str(p["exit"] or p["reason"] or p["state"] or "-"),
            _hertz(p.get("stats") or {}),
        )
        for name, p in processes.items()
    ]
    return _table([("process", "cpu %", "MB", "starts", "end", "rates"), *rows]) if rows else []


def _hertz(stats: Mapping[str, Any]) -> str:
    known = [
        (key[:-3], value)
        for key, value in stats.items()
        if key.endswith("_hz") and isinstance(value, int | float)
    ]
    return ", ".join(f"{name} {value:g} Hz" for name, value in known[:4])


def _table(rows: list[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def _n(value: Any, digits: int) -> str:
    return f"{value:.{digits}f}" if isinstance(value, int | float) else "-"
