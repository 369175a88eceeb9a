"""Facts at the top of a run's page, as pairs (label, text): times, vehicles, programs, room. Pure."""

from __future__ import annotations

from pathlib import Path

from arena.report import run_times
from arena.report.run_data import RunData
from arena.report.separation import Separation


def facts(run: RunData, nearest: Separation | None = None) -> list[tuple[str, str]]:
    """Return the facts below the verdict on a run's page, as pairs (label, text)."""
    outcome, found = run.outcome, list[tuple[str, str]]()
    if run.replay_of:
        found.append(("replay of", run.replay_of))
    if outcome.get("start"):
        found.append(("start", str(outcome["start"]).replace("T", " ")[:19]))
    found += run_times.facts(run)
    found.append(("vehicles", f"{len(run.names)}"))
    if pilots := _autopilots(run):
        found.append(("autopilot", pilots))
    if programs := _programs(run):
        found.append(("program" if len(programs) == 1 else "programs", "; ".join(programs)))
    if run.size_m:
        found.append(("room", " x ".join(f"{float(x):g}" for x in run.size_m) + " m (north x east x height)"))
    if fence := _fence_words(run):
        found.append(("geofence", fence))
    if nearest is not None:
        pair = " and ".join(nearest.names)
        found.append(("smallest separation", f"{nearest.distance_m:.2f} m ({pair}, at {nearest.at_s:.1f} s)"))
    if outcome.get("exit_code") and not run.scenario.get("passed"):
        found.append(("exit code of arena", f"{outcome['exit_code']}"))
    found.append(("run folder", run.folder.resolve().name))
    return found


def _autopilots(run: RunData) -> str:
    """Return the autopilots of a run as text, such as `PX4 v1.16.0 SITL`, or "" if the plan names none."""
    found: dict[str, list[str]] = {}
    for vehicle in run.plan.get("vehicles", ()):
        kind, name = str(vehicle.get("autopilot", "")), str(vehicle["name"])
        words = _AUTOPILOT.get(kind, kind)
        if kind == "px4":
            given = run.plan.get("slices", {}).get(f"px4.{name}.json") or {}
            version = str(given.get("version") or "").lstrip("v")
            words = (
                "arena's stand-in for PX4"
                if given.get("stand_in")
                else f"PX4 {version} SITL".replace("  ", " ")
            )
        if words:
            found.setdefault(words, []).append(name)
    return _with_names(found)


def _programs(run: RunData) -> list[str]:
    """Return the file names of the user programs as text. Several programs are listed with their vehicles."""
    found: dict[str, list[str]] = {}
    for process in run.plan.get("processes", ()):
        name, argv = str(process.get("name", "")), [str(word) for word in process.get("argv") or ()]
        if not name.startswith("program.") or not argv:
            continue
        file = next((word for word in argv if word.endswith((".py", ".ipynb"))), argv[0])
        found.setdefault(Path(file).name, []).append(name.removeprefix("program."))
    return _with_names(found).split("; ") if found else []


def _with_names(found: dict[str, list[str]]) -> str:
    """Return names as text, each name followed by its vehicles if there are several names.

    found: thing -> names of its vehicles.
    """
    if len(found) <= 1:
        return "".join(found)
    most = 4
    return "; ".join(
        f"{what} ({', '.join(names) if len(names) <= most else f'{len(names)} vehicles'})"
        for what, names in found.items()
    )


def _fence_words(run: RunData) -> str:
    """Return the limits of the geofence as text, or "" without a geofence."""
    given = run.plan.get("slices", {}).get("recorder.json") or {}
    box = given.get("fence")
    if not box:
        return ""
    (south, north), (west, east) = box["north"], box["east"]
    return f"north {south:g} to {north:g} m, east {west:g} to {east:g} m, up to {box['up']:g} m"


_AUTOPILOT = {
    "builtin": "built-in autopilot (simulated, not PX4)",
    "px4": "PX4 SITL",
    "hardware": "real flight controller",
    "hitl": "flight controller in the loop",
    "replay": "replayed",
}
