"""Finds PX4 SITL and its version on this computer. Reads files only.

The search order is the folder in the YAML's `px4.home`, else $PX4_HOME, else `px4` on PATH. A folder may be a source tree,
a build folder or an installation: it needs a binary `bin/px4` and a folder `etc` with the startup scripts. The value
`stand-in` selects arena's PX4 stand-in: the built-in autopilot with PX4's simulator API and command line. It is for tests,
and for computers without PX4.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from arena.constants import PX4_HOME
from arena.errors import NotInstalledError
from arena.schema.arena import Px4

STAND_IN = "stand-in"
_BUILDS = ("", "build/px4_sitl_default", "build/px4_sitl")
_DATA = ("etc", "../etc", "../share/px4/etc", "share/px4/etc", "../lib/px4/etc")
# Versions before 1.9 are ignored, because the binary also contains version strings up to 1.8 from PX4's own tests
_TAG = re.compile(rb"\x00v(1\.(?:9|[1-9]\d)\.\d{1,2}(?:-[0-9a-z.\-]{1,40})?)\x00")

WAYS = (
    "build it from its sources (make px4_sitl_default) and set PX4_HOME to the source or build folder",
    "install the px4 package of PX4 1.17 or newer, which puts `px4` on PATH",
    "name the folder in the YAML: `px4: {home: /path/to/PX4}`",
    "or fly without it: autopilot: builtin",
)


def find_px4(home: str | None = None, env: Mapping[str, str] | None = None) -> Px4 | None:
    """Return the first PX4 SITL that has both its binary and its startup scripts, or None.

    Search order: the YAML's `px4.home`, $PX4_HOME, `px4` on PATH.

    home: `px4.home` of the YAML. If it is given, no other folder is searched.
    env: environment variables; None for those of this process.
    """
    for folder, source in _candidates(home, os.environ if env is None else env):
        found = _stand_in(source) if str(folder) == STAND_IN else _at(folder, source)
        if found is not None:
            return found
    return None


def need_px4(home: str | None = None, env: Mapping[str, str] | None = None) -> Px4:
    """Return the installed PX4 SITL. Raises NotInstalledError with the ways to install PX4."""
    found = find_px4(home, env)
    if found is None:
        places = _candidates(home, os.environ if env is None else env)
        looked = ", ".join(f"{source} ({folder})" for folder, source in places) or "PATH"
        raise NotInstalledError(f"PX4 was not found; searched {looked}. To get it:\n  " + "\n  ".join(WAYS))
    return found


def _candidates(home: str | None, env: Mapping[str, str]) -> Iterator[tuple[Path, str]]:
    if home:
        yield Path(home).expanduser(), "px4.home of the YAML"
        return  # no other PX4 than the one that the YAML names
    if env.get(PX4_HOME):
        yield Path(env[PX4_HOME]).expanduser(), f"${PX4_HOME}"
    on_path = shutil.which("px4", path=env.get("PATH"))
    if on_path:
        yield Path(on_path).resolve().parent.parent, "px4 on PATH"


def _at(folder: Path, source: str) -> Px4 | None:
    for build in _BUILDS:
        binary = folder / build / "bin" / "px4"
        if not binary.is_file() or not os.access(binary, os.X_OK):
            continue
        for place in _DATA:
            data = (binary.parent.parent / place).resolve()
            if (data / "init.d-posix" / "rcS").is_file():
                argv, home = (str(binary.resolve()),), str(folder.absolute())
                return Px4(argv=argv, data=str(data), version=version_of(binary), home=home, source=source)
    return None


def _stand_in(source: str) -> Px4:
    from arena.schema.library import data_folder  # it imports the YAML reader, which nothing else here needs

    argv = (sys.executable, "-m", "arena.autopilot.sitl_standin")
    data = data_folder("templates") / "px4" / "standin"
    return Px4(argv=argv, data=str(data), version="", home=STAND_IN, source=source, stand_in=True)


def version_of(binary: Path) -> str:
    """Return the version of PX4 that its binary contains, such as "1.16.0", or "" if none is found."""
    try:
        found = _TAG.search(binary.read_bytes())
    except OSError:
        return ""
    return found[1].decode() if found else ""
