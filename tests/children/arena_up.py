"""The `arena` command with an `up` that takes a plan.json instead of an arena.yaml."""

from __future__ import annotations

import sys
from pathlib import Path

from arena.cli import main, up
from arena.plan.model import Plan
from arena.supervisor import sweep_all


def plan_from_json(file: Path, overrides: list[str]) -> Plan:
    plan = Plan.from_json(file.read_text())
    sweep_all(print, plan.address)
    up._refuse_second(plan)
    return plan


up._plan = plan_from_json
sys.exit(main())
