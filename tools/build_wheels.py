"""Builds the wheels of arena for Linux x86_64 and aarch64 in dist/: `make wheels`.

One computer builds both. ziglang compiles for either architecture, against glibc 2.17 (manylinux2014), with the headers
of the Python that runs this file: on 64-bit Linux they are the same for both. auditwheel checks the wheels.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
DIST = ROOT / "dist"
ARCHITECTURES = ("x86_64", "aarch64")
GLIBC = "2.17"
POLICY = "manylinux2014"
AUDITED = f"manylinux_{GLIBC.replace('.', '_')}"  # the name of the same policy in auditwheel's report
PACKAGES = {
    "ziglang": "ziglang",
    "auditwheel": "auditwheel",
    "Cython": "cython",
    "setuptools": "setuptools",
    "pip": "pip",
}
VERSION = f"{sys.version_info.major}{sys.version_info.minor}"


def missing_tools() -> list[str]:
    """Return one text per missing tool, with what to do."""
    found = [
        f"{package} is missing: pip install {package}"
        for module, package in PACKAGES.items()
        if find_spec(module) is None
    ]
    header = Path(sysconfig.get_path("include"), "Python.h")
    if not header.exists():
        found.append(f"Python's headers are missing ({header}): apt install python3-dev")
    if sys.platform != "linux" or sys.implementation.name != "cpython" or sys.maxsize < 2**32:
        found.append("wheels are built with a 64-bit CPython on Linux")
    return found


def suffix(architecture: str) -> str:
    """Return how the file name of a compiled module ends."""
    return f".cpython-{VERSION}-{architecture}-linux-gnu.so"


def environment(architecture: str, config: Path) -> dict[str, str]:
    """Return the environment variables with which setuptools compiles for an architecture."""
    compiler = (
        f"{sys.executable} -m ziglang cc -target {architecture}-linux-gnu.{GLIBC} -fno-sanitize=undefined"
    )
    return {
        **os.environ,
        "CC": compiler,
        "LDSHARED": f"{compiler} -shared",
        "_PYTHON_HOST_PLATFORM": f"linux-{architecture}",
        "SETUPTOOLS_EXT_SUFFIX": suffix(architecture),
        "DIST_EXTRA_CONFIG": str(config),
    }


def build(architecture: str) -> Path:
    """Build the wheel of an architecture in DIST, and return its path."""
    with tempfile.TemporaryDirectory() as temporary:
        config, made = Path(temporary, "setup.cfg"), Path(temporary, "wheels")
        config.write_text(
            f"[build]\nbuild_base = {temporary}/build\n[bdist_wheel]\nplat_name = {POLICY}_{architecture}\n"
        )
        argv = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
        subprocess.run(
            [*argv, "--wheel-dir", str(made), str(ROOT)], env=environment(architecture, config), check=True
        )
        (wheel,) = made.iterdir()
        DIST.mkdir(exist_ok=True)
        return wheel.replace(DIST / wheel.name)


def problems(wheel: Path, architecture: str) -> list[str]:
    """Return what is wrong with a wheel: kernels that are not compiled, or symbols newer than the policy allows."""
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    kernels = [name.removesuffix(".pxd") for name in names if name.endswith(".pxd")]
    found = [f"{name} is not compiled" for name in kernels if name + suffix(architecture) not in names]
    found += [
        f"{n} is of another system" for n in names if n.endswith(".so") and suffix(architecture) not in n
    ]
    report = subprocess.run(
        [sys.executable, "-m", "auditwheel", "show", str(wheel)], capture_output=True, text=True, check=False
    )
    if f'platform tag: "{AUDITED}_{architecture}"' not in " ".join(report.stdout.split()):
        found.append(f"auditwheel: not {AUDITED}_{architecture}: {report.stdout}{report.stderr}")
    return found


def main() -> int:
    """Build and check all wheels. Return the exit code."""
    if missing := missing_tools():
        print("\n".join(f"wheels: {text}" for text in missing), file=sys.stderr)
        return 1
    wrong = 0
    for architecture in ARCHITECTURES:
        wheel = build(architecture)
        found = problems(wheel, architecture)
        wrong += len(found)
        print(f"{wheel.relative_to(ROOT)}: {'; '.join(found) or 'built'}", flush=True)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
