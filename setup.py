"""Carries `profiles/` and `templates/` into the built package, as `arena/_data`; all the rest is in pyproject.toml."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

HERE = Path(__file__).parent
FOLDERS = ("profiles", "templates")


class BuildWithData(build_py):
    """`arena.schema.library.data_folder` looks there first; an editable install has the folders beside the package."""

    def run(self) -> None:
        super().run()
        if not getattr(self, "editable_mode", False):
            for folder in FOLDERS:
                shutil.copytree(
                    HERE / folder, Path(self.build_lib) / "arena" / "_data" / folder, dirs_exist_ok=True
                )


setup(cmdclass={"build_py": BuildWithData})
