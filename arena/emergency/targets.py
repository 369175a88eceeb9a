"""Whom to land: from the running plan, or else from the YAML. Reads files itself, so that nothing else need be healthy."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from arena.emergency.direct_address import Wire, as_last_seen, from_slice
from arena.emergency.yaml_fallback import Named, read_yaml, vehicles_of
from arena.errors import InputError
from arena.run_dirs import pointers

Address = tuple[str, int]
_LINK_BASE, _PANIC_AUTOPILOT, _PANIC_PARTNER, _TOOLS = 24000, 4, 5, 6


@dataclass(frozen=True, kw_only=True)
class Target:
    """One vehicle. autopilot, partner: the two ends of its panic link.  tools: where its router listens.

    run: the folder of a simulated one's run, whose record tells of a crash.  wire: of a real one.
    """

    name: str
    id: int
    autopilot: Address
    partner: Address
    tools: Address
    run: Path | None = field(default=None, compare=False)
    wire: Wire | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class Found:
    """source: where the addresses come from, in words.  unread: why whole runs are left out, a sentence each."""

    source: str
    targets: tuple[Target, ...]
    unread: tuple[str, ...] = ()


def find(*, arena: Path | None = None, run: Path | None = None) -> Found:
    """--run, else the active runs, else the YAML. Raises InputError.

    Of a YAML that is given, the runs that were started from it, whatever it says by now; else one on its address.
    """
    if run is not None:
        return _of_run(run)
    runs = active_runs()
    if arena is None:
        if found := _of_runs(runs):
            return found
        arena = Path("arena.yaml")
        if not arena.is_file():
            raise InputError(
                "nothing to land: no run is active, and there is no arena.yaml here. Name one: arena land-all FILE"
            )
    arena = arena / "arena.yaml" if arena.is_dir() else arena
    if found := _of_runs([folder for folder in runs if _began_from(folder) == str(arena.resolve())]):
        return found
    written = from_yaml(arena)
    hosts = {target.tools[0] for target in written.targets}
    for folder in reversed(runs):
        with contextlib.suppress(InputError):
            running = _of_run(folder)
            if hosts & {target.tools[0] for target in running.targets}:
                return running
    return written


def _of_runs(folders: Iterable[Path]) -> Found | None:
    """Everybody in them; one that cannot be read keeps nobody from landing, and is told."""
    plans, unread = [], []
    for folder in folders:
        try:
            plans.append(_of_run(folder))
        except InputError as error:
            unread.append(str(error))
    if not plans:
        return None
    targets = _distinct(t for p in plans for t in p.targets)
    return Found(source=", ".join(p.source for p in plans), targets=targets, unread=tuple(unread))


def _began_from(folder: Path) -> str:
    """The YAML that a run was started from: the first line of its resolved one tells."""
    try:
        with (folder / "arena.yaml").open(errors="replace") as file:
            return str(Path(file.readline().partition("# resolved from ")[2].strip()).resolve())
    except OSError:
        return ""


def choose(
    targets: Sequence[Target], only: Sequence[str] = (), spared: Sequence[str] = ()
) -> tuple[Target, ...]:
    """Those named by `only` (all when empty) without `spared`. Raises InputError for a name that is no vehicle."""
    names = [target.name for target in targets]
    for name in (*only, *spared):
        if name not in names:
            raise InputError(f"got vehicle {name}, expected one of {', '.join(names)}")
    return tuple(t for t in targets if (not only or t.name in only) and t.name not in spared)


def active_runs() -> list[Path]:
    """Run folders of this user that did not end cleanly and of which a process still runs, oldest first."""
    found = []
    for pointer in pointers():
        with contextlib.suppress(OSError):
            folder = Path(pointer.read_text().strip())
            if (state := folder / "state.json").is_file() and _anyone_runs(state):
                found.append((state.stat().st_mtime, folder))
    return [folder for _, folder in sorted(found)]


def from_plan(text: str, run: Path | None = None) -> tuple[Target, ...]:
    """The vehicles of a plan.json, which lies in this run. Raises ValueError, KeyError or TypeError when it is none."""
    plan = json.loads(text)
    return tuple(
        Target(
            name=str(v["name"]),
            id=int(v["id"]),
            autopilot=(v["panic"]["autopilot_host"], int(v["panic"]["autopilot_port"])),
            partner=(v["panic"]["partner_host"], int(v["panic"]["partner_port"])),
            tools=(v["router"]["partner_host"], int(v["tools_port"])),
            run=run if v["simulated"] is True else None,
            wire=None if v["simulated"] is True else _planned_wire(plan, str(v["name"]), run),
        )
        for v in plan["vehicles"]
    )


def _planned_wire(plan: Any, vehicle: str, run: Path | None) -> Wire | None:
    try:
        wire = from_slice(plan["slices"][f"link.{vehicle}.json"]["wire"])
    except (KeyError, TypeError, ValueError):
        return None
    return as_last_seen(wire, vehicle, run) if run is not None else wire


def from_yaml(path: Path) -> Found:
    """By the rule of ports. Raises InputError when there is no such file or it names no vehicle at all."""
    try:
        text = path.read_text(errors="replace")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    host, vehicles = vehicles_of(read_yaml(text))
    if not vehicles:
        raise InputError(f"{path}: no vehicle can be found in it. Expected `vehicles:` with one name a line")
    return Found(source=str(path), targets=tuple(_by_rule(one, host) for one in vehicles))


def _by_rule(one: Named, host: str) -> Target:
    base = _LINK_BASE + 10 * one.id
    autopilot, partner, tools = ((host, base + k) for k in (_PANIC_AUTOPILOT, _PANIC_PARTNER, _TOOLS))
    return Target(name=one.name, id=one.id, autopilot=autopilot, partner=partner, tools=tools, wire=one.wire)


def _of_run(folder: Path) -> Found:
    """Its plan, or, if that cannot be read, the YAML beside it."""
    try:
        return Found(source=str(folder), targets=from_plan((folder / "plan.json").read_text(), folder))
    except (OSError, ValueError, KeyError, TypeError) as error:
        if (folder / "arena.yaml").is_file():
            return from_yaml(folder / "arena.yaml")
        why = (
            "no such folder"
            if not folder.is_dir()
            else f"no plan.json and no arena.yaml that can be read: {error}"
        )
        raise InputError(f"{folder}: {why}") from error


def _distinct(targets: Iterable[Target]) -> tuple[Target, ...]:
    return tuple({target.autopilot: target for target in targets}.values())


def _anyone_runs(state: Path) -> bool:
    """Whether a recorded process exists. When in doubt, yes: a ghost is reported as not confirmed, a vehicle is landed."""
    try:
        raw = json.loads(state.read_text())
        members: list[Any] = [raw["supervisor"], *raw["processes"].values()]
        return any(Path(f"/proc/{member['pid']}").exists() for member in members)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return True
