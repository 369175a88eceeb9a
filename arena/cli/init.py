"""`arena init NAME`: create a folder with an example arena that is ready to fly."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from arena.errors import InputError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")


def register(app: typer.Typer) -> None:
    """Add the command `arena init` to the typer app."""

    @app.command()
    def init(
        folder: Annotated[
            Path,
            typer.Argument(metavar="NAME", help="the folder to create; its name is the name of the arena"),
        ],
    ) -> None:
        """Create a folder with an example: arena.yaml, a ten-line program, a scenario, a README and a .gitignore."""
        for path in scaffold(folder):
            print(path)
        print(f"next: cd {folder} && arena check && arena up")


def scaffold(folder: Path) -> list[Path]:
    """Write the files of a new arena and return their paths.

    Raises InputError if one of the files already exists.
    """
    import jinja2

    from arena.schema import data_folder

    name = folder.resolve().name
    if not _NAME.fullmatch(name):
        suggestion = re.sub("[^A-Za-z0-9]+", "_", name).strip("_") or "lab1"
        raise InputError(
            f"got the name {name!r}, expected letters, digits, _ . and - only. Try {suggestion}."
        )
    templates = sorted((data_folder("templates") / "init").glob("*.j2"))
    targets = {template: folder / _file_name(template) for template in templates}
    if existing := [str(target) for target in targets.values() if target.exists()]:
        raise InputError(
            f"{', '.join(existing)} already exists and is not overwritten. Choose another name for the arena."
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for template, target in targets.items():
            text = jinja2.Template(
                template.read_text(), keep_trailing_newline=True, undefined=jinja2.StrictUndefined
            )
            target.write_text(text.render(name=name))
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror}") from error
    return list(targets.values())


def _file_name(template: Path) -> str:
    return ".gitignore" if template.stem == "gitignore" else template.stem
