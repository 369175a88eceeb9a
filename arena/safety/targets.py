"""Whom to land: from the running plan, or else from the YAML. Reads files itself, so that nothing else need be healthy."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from arena.errors import InputError
from arena.rundirs import runtime_bases
from arena.safety.lenient import read_yaml, vehicles_of

Address = tuple[str, int]
_LINK_BASE, _PANIC_AUTOPILOT, _PANIC_PARTNER, _TOOLS = 24000, 4, 5, 6


@dataclass(frozen=True, kw_only=True)
class Target:
    """One vehicle. autopilot, partner: the two ends of its panic link.  tools: where its router listens.

    run: the folder of a simulated one's run, whose record tells of a crash.
    """

    name: str
    id: int
    autopilot: Address
    partner: Address
    tools: Address
    run: Path | None = field(default=None, compare=False)


@dataclass(frozen=True, kw_only=True)
class Found:
    """source: where the addresses come from, in words."""

    source: str
    targets: tuple[Target, ...]


def find(*, arena: Path | None = None, run: Path | None = None) -> Found:
    """--run, else the active runs (of the same address when a YAML is given), else the YAML. Raises InputError."""
    if run is not None:
        return _of_run(run)
    runs = active_runs()
    if arena is None:
        plans = [_of_run(folder) for folder in runs]
        if plans:
            return Found(source=", ".join(p.source for p in plans), targets=_distinct(t for p in plans for t in p.targets))
        arena = Path("arena.yaml")
        if not arena.is_file():
            raise InputError("nothing to land: no run is active, and there is no arena.yaml here. Name one: arena land-all FILE")
    written = from_yaml(arena)
    hosts = {target.tools[0] for target in written.targets}
    for folder in reversed(runs):
        with contextlib.suppress(InputError):
            running = _of_run(folder)
            if hosts & {target.tools[0] for target in running.targets}:
                return running
    return written


def choose(targets: Sequence[Target], only: Sequence[str] = (), spared: Sequence[str] = ()) -> tuple[Target, ...]:
    """Those named by `only` (all when empty) without `spared`. Raises InputError for a name that is no vehicle."""
    names = [target.name for target in targets]
    for name in (*only, *spared):
        if name not in names:
            raise InputError(f"got vehicle {name}, expected one of {', '.join(names)}")
    return tuple(t for t in targets if (not only or t.name in only) and t.name not in spared)


def active_runs() -> list[Path]:
    """Run folders of this user that did not end cleanly and of which a process still runs, oldest first."""
    found = []
    for base in runtime_bases():
        for pointer in sorted(base.glob("*/run")) if base.is_dir() else []:
            with contextlib.suppress(OSError):
                folder = Path(pointer.read_text().strip())
                if (state := folder / "state.json").is_file() and _anyone_runs(state):
                    found.append((state.stat().st_mtime, folder))
    return [folder for _, folder in sorted(found)]


def from_plan(text: str, run: Path | None = None) -> tuple[Target, ...]:
    """The vehicles of a plan.json, which lies in this run. Raises ValueError, KeyError or TypeError when it is none."""
    return tuple(
        Target(
            name=str(v["name"]), id=int(v["id"]),
            autopilot=(v["panic"]["autopilot_host"], int(v["panic"]["autopilot_port"])),
            partner=(v["panic"]["partner_host"], int(v["panic"]["partner_port"])),
            tools=(v["router"]["partner_host"], int(v["tools_port"])),
            run=run if v["simulated"] is True else None,
        )
        for v in json.loads(text)["vehicles"]
    )


def from_yaml(path: Path) -> Found:
    """By the rule of ports. Raises InputError when there is no such file or it names no vehicle at all."""
    try:
        text = path.read_text(errors="replace")
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from error
    host, vehicles = vehicles_of(read_yaml(text))
    if not vehicles:
        raise InputError(f"{path}: no vehicle can be found in it. Expected `vehicles:` with one name a line")
    return Found(source=str(path), targets=tuple(_by_rule(name, number, host) for name, number in vehicles))


def _by_rule(name: str, number: int, host: str) -> Target:
    base = _LINK_BASE + 10 * number
    autopilot, partner, tools = ((host, base + k) for k in (_PANIC_AUTOPILOT, _PANIC_PARTNER, _TOOLS))
    return Target(name=name, id=number, autopilot=autopilot, partner=partner, tools=tools)


def _of_run(folder: Path) -> Found:
    """Its plan, or, if that cannot be read, the YAML beside it."""
    try:
        return Found(source=str(folder), targets=from_plan((folder / "plan.json").read_text(), folder))
    except (OSError, ValueError, KeyError, TypeError) as error:
        if (folder / "arena.yaml").is_file():
            return from_yaml(folder / "arena.yaml")
        raise InputError(f"{folder}: no plan.json and no arena.yaml that can be read: {error}") from error


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
