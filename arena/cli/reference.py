"""Generator of the pages in docs/reference: `python -m arena.cli.reference [FOLDER]`.

Pages: keys of the YAML, ports, processes, exit codes, the command line, words of scenarios, columns of the log, channels
of a record, MAVLink ids. Do not edit these pages by hand: a test generates them again and compares.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import typer.main

from arena import errors
from arena.cli import VERBS, build_complete
from arena.cli.reference_channels import channels_page
from arena.cli.reference_mavlink_ids import mavlink_ids_page
from arena.cli.reference_placeholders import placeholders_page
from arena.cli.reference_ros2 import ros2_page
from arena.flight_log import columns
from arena.mocap.vendors import VENDORS, vendor_settings
from arena.plan import ProcessSpec, Restart, make_plan
from arena.plan.model import PROGRAMS
from arena.plan.process_table import TABLE, ProcessKind
from arena.schema import load_arena
from arena.schema.descriptions import descriptions
from arena.schema.mocap import Mocap
from arena.schema.models import NOT_YET, json_schema
from arena.schema.ports import PORTS, Port
from arena.smoke.language import vocabulary
from arena.smoke.language.scenario_file import STEP_KEYS, ScenarioFile

FOLDER = Path(__file__).parents[2] / "docs" / "reference"
_HEAD = "<!-- written by python -m arena.cli.reference; do not edit -->\n\n"
_EXAMPLE = "vehicles: {uav1: {autopilot: builtin, program: hover.py}}\n"


def pages() -> dict[str, str]:
    """Return the text of every generated reference page, by file name."""
    made = {
        "yaml.md": yaml_page(),
        "placeholders.md": placeholders_page(table),
        "ros2-topics.md": ros2_page(table),
        "ports.md": ports_page(),
        "processes.md": processes_page(),
        "exit-codes.md": exit_codes_page(),
        "cli.md": cli_page(),
        "scenarios.md": scenarios_page(),
        "log-columns.md": log_columns_page(),
        "channels.md": channels_page(table),
        "mavlink-ids.md": mavlink_ids_page(table),
    }
    return {name: _HEAD + text.rstrip() + "\n" for name, text in made.items()}


def table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table as Markdown text. head: titles of the columns."""
    head = list(head)
    lines = [
        "| " + " | ".join(row) + " |"
        for row in ([*head], ["---"] * len(head), *([str(c) for c in row] for row in rows))
    ]
    return "\n".join(lines) + "\n"


def yaml_page() -> str:
    """Return the reference page of all keys of arena.yaml, made from the JSON schema."""
    schema = json_schema()
    defs = schema["$defs"]
    text = "# Keys of arena.yaml\n\n- Unknown keys, repeated keys, NaN and infinity are refused.\n"
    text += "- Scalars are read by the rules of YAML 1.2.\n"
    text += "- If several sources give a value, the last of this list wins: built-in default, profile, section `defaults`,\n"
    text += "  the vehicle's own entry, `--set key=value`.\n\n"
    text += "## The arena\n\n" + _keys(schema)
    order = [
        "World", "Obstacle", "Origin", "Sim", "Px4Keys", "Mocap", "MocapNoise", "LogKeys", "Foxglove", "VehicleKeys", "Start", "Grid",
        "Neighbours", "NeighbourNoise", "BeaconSensor", "BeaconNoise",
        "Measured", "Signing", "Program", "Tool", "Ready", "Ros2", "Microxrce", "Mavros", "Bag", "Qgroundcontrol", "VehicleDefaults",
        "Preflight", "Failsafe", "OffboardLoss",
        "PositionLoss", "LowBattery", "RcLoss", "DataLinkLoss", "FenceLoss", "AttitudeLoss",
        "Geofence", "Copilot", "GeofenceRule", "SeparationRule", "TiltRule", "SpeedRule",
        "PoseAgeRule", "EstimateRule", "BatteryRule", "ProgramRule", "Host",
    ]  # fmt: skip
    if set(order) != set(defs):
        raise ValueError(
            f"the list `order` of yaml_page must name all sections of the JSON schema: add {sorted(set(defs) - set(order))}, "
            f"remove {sorted(set(order) - set(defs))}"
        )
    for name in order:
        text += f"\n## {name}\n\n{defs[name].get('description', '')}\n\n" + _keys(defs[name])
    text += "\n## Not available yet\n\n"
    return text + table(
        ("key", "value", "instead"), ((f"`{k}`", v or "any", instead) for (k, v), instead in NOT_YET.items())
    )


def _keys(model: dict[str, Any]) -> str:
    rows = (
        (
            f"`{k}`",
            _type(p),
            _default(p, k in model.get("required", ())),
            p.get("description", "").replace("\n", " "),
        )
        for k, p in model["properties"].items()
    )
    return table(("key", "value", "default", "meaning"), rows)


def _default(schema: dict[str, Any], required: bool) -> str:
    value = schema.get("default")
    if required:
        return "required"
    return (
        ""
        if value is None or isinstance(value, dict)
        else f"`{str(value).lower() if isinstance(value, bool) else value}`"
    )


def _type(schema: dict[str, Any]) -> str:
    """Return a short text about the type of a value in a JSON schema, such as `number above 0`."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{x}`" for x in schema["enum"])
    if "anyOf" in schema:
        return " or ".join(_type(s) for s in schema["anyOf"] if s.get("type") != "null")
    return _simple(schema)


def _simple(schema: dict[str, Any]) -> str:
    kind = schema.get("type")
    if kind == "array":
        return (
            f"{len(schema['prefixItems'])} numbers"
            if "prefixItems" in schema
            else f"list of {_type(schema['items'])}"
        )
    if kind == "object":
        return f"mapping {{name: {_type(schema['additionalProperties'])}}}"
    words = {"integer": "integer", "number": "number", "string": "text", "boolean": "true or false"}[
        str(kind)
    ]
    return words + _range(schema)


def _range(schema: dict[str, Any]) -> str:
    low, above = schema.get("minimum"), schema.get("exclusiveMinimum")
    high, below = schema.get("maximum"), schema.get("exclusiveMaximum")
    limits = (("from", low), ("above", above), ("to", high), ("below", below))
    return "".join(f" {word} {limit}" for word, limit in limits if limit is not None)


def ports_page() -> str:
    """Return the reference page of all UDP and TCP ports that an arena opens."""
    rows = [(port.rule, port.owner, port.use, _accepted_senders(port)) for port in PORTS]
    for vendor in VENDORS:
        for key, use in vendor_settings(vendor).PORTS.items():
            rule = f"{getattr(Mocap(), key)}, or `mocap.{key}`"
            rows.append(
                (
                    rule,
                    "the motion capture",
                    f"{use} ({vendor})",
                    "any client: it gets poses and cannot send flight commands",
                )
            )
    text = "# Ports\n\n- All ports are on the arena's `address` (default 127.0.0.1).\n"
    text += "- All ports are UDP, except for PX4's simulator API, Foxglove and the monitor, which are TCP.\n"
    text += "- `id` is the vehicle's MAV_SYS_ID.\n"
    text += "- The messages of a vehicle are also sent to each of its `gcs` addresses: to its program port, its SDK port and\n"
    text += "  14550 there.\n\n"
    return text + table(("port", "opened by", "used for", "accepted senders, by process"), rows)


def _accepted_senders(port: Port) -> str:
    """Return the text of one table cell: the senders from which a port accepts datagrams.

    Example: `router`: any sender. There is one entry per kind of process that can open the port.
    """
    found: dict[str, list[str]] = {}
    for binder in port.binders:
        found.setdefault(binder.answers, []).append(f"`{binder.kind}`")
    return "; ".join(f"{', '.join(kinds)}: {words}" for words, kinds in found.items())


def processes_page() -> str:
    """Return the reference page of processes: all kinds, and the processes of an example with one vehicle."""
    head = ("process", "module", "purpose", "CPU, memory budget", "restart", "ports")
    text = "# Processes\n\nThe table lists every kind of process, in start order. `ps` shows a process as `arena:NAME`.\n"
    text += "Each vehicle has a separate process of the kinds with `.VEHICLE`, each group of programs one of the kind `group.NAME`.\n\n"
    text += table(head, (_kind(row) for row in TABLE))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "arena.yaml"
        file.write_text(_EXAMPLE)
        (Path(folder) / "hover.py").touch()
        plan = make_plan(load_arena(file), "python")
        specs = [*plan.processes, *(task for task in (plan.land, plan.report) if task)]
        rows = [[cell.replace(f"{folder}/", "") for cell in _process(spec)] for spec in specs]
    head = (
        "name",
        "needs",
        "ready when",
        "time limit of start, stop",
        "continues without the supervisor",
        "command",
    )
    text += "\n## An arena with one vehicle\n\nThe processes start in this order. A process starts when the processes that it\n"
    text += "needs are ready, and stops before them. The last two rows are tasks that the supervisor starts when the run\n"
    text += "ends. `{run}` is the run folder.\n\n"
    return text + table(head, rows)


def _kind(row: ProcessKind) -> list[str]:
    restart: Restart = row.fields.get("restart", Restart(mode="on_failure"))
    mode = "as the YAML says" if row.kind in ("copilot", *PROGRAMS) else restart.mode
    ports = [port.rule for port in PORTS if port.binder("program" if row.per_group else row.kind) is not None]
    return [
        f"`{row.kind}{'.VEHICLE' if row.per_vehicle else '.NAME' if row.per_group else ''}`",
        f"`{row.module}`" if row.module else "",
        row.purpose,
        f"{row.cpu_budget:g} cores, {row.memory_budget_mb:g} MB",
        mode,
        "; ".join(ports),
    ]


_READY = {"reported": "it reports READY", "started": "it is started"}


def _process(spec: ProcessSpec) -> list[str]:
    return [
        f"`{spec.name}`",
        ", ".join(spec.needs),
        _READY[spec.ready],
        f"{spec.start_timeout_s:g} s, {spec.stop_timeout_s:g} s",
        "yes" if spec.outlives else "no",
        f"`{' '.join(spec.argv)}`",
    ]


def log_columns_page() -> str:
    """Return the reference page of all columns of a vehicle's log, with an example program that reads the log."""

    def rows(groups: Iterable[columns.Group]) -> Iterator[tuple[str, ...]]:
        for group in groups:
            name = f"`{group.name}`" + (f" `.{'`, `.'.join(group.parts)}`" if group.parts else "")
            yield name, group.unit, group.frame, group.source, group.instant, group.meaning

    head = ("columns", "unit", "frame", "source", "instant", "meaning")
    return "\n".join(
        (
            "# Columns of the log\n",
            columns.PAGE_HEAD,
            table(head, rows((*columns.THESIS, *columns.FURTHER))),
            "## Simulated vehicles\n",
            "The log of a simulated vehicle also contains the true state from the simulated world.\n",
            table(head, rows(columns.TRUTH)),
            columns.PAGE_EXAMPLE,
        )
    )


def scenarios_page() -> str:
    """Return the reference page of all keys, words and operators of a scenario."""
    states = {f"V.{state}": meaning for state, meaning in vocabulary.STATES.items()}
    values = {f"V.{name} < X {q.unit}": f"{q.meaning}; also `>`" for name, q in vocabulary.QUANTITIES.items()}
    actions = ((f"`{form.form}`", "yes" if form.lasting else "", form.meaning) for form in vocabulary.ACTIONS)
    parts = (
        "# Scenarios",
        "A scenario is a YAML file for `arena smoke`. The whole file is checked before the flight. Times are simulated.\n"
        "[Write a scenario](../howto/write-a-scenario.md) is the introduction.",
        f"```yaml\n{vocabulary.EXAMPLE}```",
        _meanings(
            "key",
            {key: text.replace("\n", " ") for key, text in descriptions(ScenarioFile).items()},
        ),
        "## Steps",
        "Steps follow each other. A step begins when all expectations of the step before are fulfilled. An entry with only\n"
        "`expect` belongs to the step before it. A failed step ends the flight.",
        _meanings("key", STEP_KEYS),
        "## Triggers, expectations and rules",
        _meanings("written", vocabulary.PHRASES),
        "## Conditions",
        "- `not` before a condition negates it.\n"
        "- `each` in place of a vehicle's name: the condition must be true for every vehicle.\n"
        "- While a value is unknown, an expectation is not fulfilled, and a rule of `always` is not violated. "
        "A value of the telemetry is unknown when it is 1 s old. "
        "If a value is unknown for more than 2 s, an expectation with `for` and a rule fail.\n"
        "- Values marked *truth* come from the simulated world, values marked *telemetry* from the vehicle's MAVLink messages.",
        _meanings("condition", {**states, **values, **vocabulary.OTHER_CONDITIONS}),
        "## Actions",
        "An action with `yes` in the second column can end in `for T`: it is undone after that time. `each` means every vehicle.",
        table(("action", "`for T`", "effect"), actions),
        "## Meaning of the letters",
        _meanings("letter", vocabulary.PARTS),
        "## Accepted failures",
        "Without an entry in `may`, the scenario fails if a vehicle crashes, if a vehicle has not landed at the end, or if a process\n"
        "fails. Processes that an action has killed, stopped or restarted do not count. Entries of `may` accept failures:",
        _meanings("entry of `may`", vocabulary.ALLOWANCES),
    )
    return "\n\n".join(part.rstrip("\n") for part in parts)


def _meanings(head: str, words: Mapping[str, str]) -> str:
    return table((head, "meaning"), ((f"`{word}`", meaning) for word, meaning in words.items()))


def exit_codes_page() -> str:
    """Return the reference page of exit codes and exceptions."""
    codes = [
        (errors.EXIT_OK, "done"),
        (errors.EXIT_FAILED, "the run failed because of a vehicle, a program, a process or an assertion"),
        (
            errors.EXIT_INPUT,
            "the input is wrong (the YAML, a file or the command line), or something is not installed",
        ),
        (errors.EXIT_INTERRUPTED, "interrupted by Ctrl-C"),
    ]
    text = "# Exit codes and exceptions\n\n" + table(
        ("code", "meaning"), ((str(c), words) for c, words in codes)
    )
    rows = (
        (f"`{kind.__name__}`", str(kind.exit_code), (kind.__doc__ or "").splitlines()[0])
        for kind in _family(errors.ArenaError)
    )
    return text + "\n" + table(("exception", "exit code", "when"), rows)


def _family(kind: type[errors.ArenaError]) -> Iterator[type[errors.ArenaError]]:
    yield kind
    for child in kind.__subclasses__():
        if child.__module__ == errors.__name__:
            yield from _family(child)


def cli_page() -> str:
    """Return the reference page of all commands with their arguments and options."""
    group: Any = typer.main.get_command(build_complete())
    text = "# The command line\n\n`--debug` before or after any command shows the traceback of a failure.\n"
    for verb, command in _commands(group):
        words = [
            _name(p) if p.required else f"[{_name(p)}]"
            for p in command.params
            if p.param_type_name == "argument"
        ]
        text += f"\n## arena {' '.join([verb, *words])}\n\n{(command.help or '').strip()}\n\n"
        rows = [_parameter(p) for p in command.params if p.name != "help"]
        text += table(("argument or option", "meaning"), rows) if rows else ""
    return text


def _commands(group: Any) -> Iterator[tuple[str, Any]]:
    """Yield (name, command) for every command of `arena`.

    The commands of a group have names such as `params push`.
    """
    for verb in (v for v in VERBS if v in group.commands):
        command = group.commands[verb]
        if inner := getattr(command, "commands", None):
            yield from ((f"{verb} {name}", each) for name, each in inner.items())
        else:
            yield verb, command


def _name(p: Any) -> str:
    return str(p.metavar or p.name).upper()


def _parameter(p: Any) -> tuple[str, str]:
    if p.param_type_name == "argument":
        return f"`{_name(p)}`", p.help or ""
    value = "" if p.is_flag else f" {p.metavar or 'VALUE'}"
    return ", ".join(f"`{option}{value}`" for option in (*p.opts, *p.secondary_opts)), (p.help or "").replace(
        "|", "\\|"
    )


def main(folder: Path) -> None:
    """Write all generated reference pages to a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in pages().items():
        (folder / name).write_text(text)
        print(folder / name)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
