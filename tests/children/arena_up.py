"""The `arena` command with an `up` that takes a plan.json instead of an arena.yaml."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from arena.cli import main
from arena.plan.model import Plan


def plan_from_json(file: Path, overrides: list[str], say: Callable[[str], None]) -> tuple[None, Plan]:
    from arena.supervisor import sweep_all

    plan = Plan.from_json(file.read_text())
    sweep_all(say, plan.address)
    return None, plan


def stay_there(arena: None, plan: Plan, overrides: list[str], say: Callable[[str], None]) -> Plan:
    from arena.cli._placing import refuse_second

    refuse_second(plan)
    return plan


if sys.argv[1:2] == ["up"]:  # other commands do not import it
    from arena.cli import up

    up._load, up.place = plan_from_json, stay_there
sys.exit(main())
