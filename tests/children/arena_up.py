"""The `arena` command with an `up` that takes a plan.json instead of an arena.yaml."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from arena.cli import main, up
from arena.cli._placing import refuse_second
from arena.plan.model import Plan
from arena.supervisor import sweep_all


def plan_from_json(file: Path, overrides: list[str], say: Callable[[str], None]) -> tuple[None, Plan]:
    plan = Plan.from_json(file.read_text())
    sweep_all(say, plan.address)
    return None, plan


def stay_there(arena: None, plan: Plan, overrides: list[str], say: Callable[[str], None]) -> Plan:
    refuse_second(plan)
    return plan


up._load, up.place = plan_from_json, stay_there
sys.exit(main())
