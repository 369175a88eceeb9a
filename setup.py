"""Compiles the kernels and carries `profiles/` and `templates/` into the built package; the other settings are in pyproject.toml.

    python setup.py build_ext --inplace      compile the kernels after a change

Without a C compiler or Python's headers, or with ARENA_NO_COMPILE=1, arena installs without compiled kernels and runs
their Python source. `make wheels` builds wheels for other computers (tools/build_wheels.py).
"""

import os
import runpy
import shutil
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py
from setuptools.errors import CompileError

HERE = Path(__file__).parent
FOLDERS = ("profiles", "templates")
KERNELS = Path("arena/kernels")
C_FILES = Path("build/kernels")
NOT_COMPILED = (
    "no C compiler that finds Python's headers, so the kernels are not compiled and simulated flights are slow. "
    "Install both (Debian and Ubuntu: apt install gcc python3-dev), then install arena again"
)
TOOLS = runpy.run_path(str(HERE / KERNELS / "source_digest.py"))
# Without contraction a * b + c is rounded twice on every architecture, as Python rounds it.
# Cython writes the C code, so nobody can mend what the compiler warns of.
FLAGS = ["-O3", "-g0", "-w", "-ffp-contract=off"]
DIRECTIVES = {
    "language_level": 3,
    "annotation_typing": False,
    "auto_pickle": False,  # nobody pickles a kernel, and the code for it takes a quarter of the compile time
    "infer_types": True,
    "wraparound": False,
    "initializedcheck": False,  # an array that is not set has the size 0, so the check of the index finds it
    "show_performance_hints": False,
}


class BuildWithData(build_py):
    """`arena.schema.library.data_folder` looks there first; an editable install has the folders beside the package."""

    def run(self) -> None:
        super().run()
        if not getattr(self, "editable_mode", False):
            for folder in FOLDERS:
                shutil.copytree(
                    HERE / folder, Path(self.build_lib) / "arena" / "_data" / folder, dirs_exist_ok=True
                )


class BuildKernels(build_ext):
    """Translates all kernels to C and compiles them, on all cores. Time stamps do not matter, because git changes them."""

    def finalize_options(self) -> None:
        super().finalize_options()
        self.force, self.parallel = True, os.cpu_count()

    def build_extensions(self) -> None:
        if not self._can_compile():
            print(f"arena: {NOT_COMPILED}", file=sys.stderr)
            self.extensions = []
            return
        from Cython.Build import cythonize

        digest = TOOLS["source_digest"](HERE / KERNELS)
        C_FILES.mkdir(parents=True, exist_ok=True)
        for name in TOOLS["compiled_names"](HERE / KERNELS):
            _digest_file(name).write_text(TOOLS["digest_as_c"](name, digest))
        in_c = cythonize(
            self.extensions,
            build_dir=str(C_FILES),
            force=True,
            quiet=True,
            compiler_directives=DIRECTIVES,
            shared_utility_qualified_name="arena.kernels._arrays",
        )
        for extension, translated in zip(self.extensions, in_c, strict=True):
            extension.sources = translated.sources
        super().build_extensions()

    def _can_compile(self) -> bool:
        """Return whether a C compiler compiles a file that includes Python's headers. The compiler prints its errors."""
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder, "headers.c")
            source.write_text("#include <Python.h>\n")
            try:
                self.compiler.compile([str(source)], output_dir=folder, include_dirs=self.include_dirs)
            except (CompileError, OSError):
                return False
        return True


def kernels() -> list[Extension]:
    """Return the kernels to compile: every module of `arena/kernels` that has a .pxd file or is a .pyx file."""
    if os.environ.get("ARENA_NO_COMPILE", "0") not in ("", "0"):
        return []
    if find_spec("Cython") is None:
        print("arena: Cython is not installed, so the kernels are not compiled")
        return []
    # This module contains what all compiled kernels need to read arrays. One copy halves the build time.
    shared = _extension("_arrays", [str(C_FILES / "_arrays.c")])
    return [shared] + [
        _extension(
            name, [str(KERNELS / TOOLS["sources"](HERE / KERNELS, name)[0].name), str(_digest_file(name))]
        )
        for name in TOOLS["compiled_names"](HERE / KERNELS)
    ]


def _digest_file(kernel: str) -> Path:
    """Return the C file that stores the digest of the sources in a compiled kernel."""
    return C_FILES / f"{kernel}_sources.c"


def _extension(name: str, sources: list[str]) -> Extension:
    return Extension(f"arena.kernels.{name}", sources, extra_compile_args=FLAGS, optional=True)


setup(cmdclass={"build_py": BuildWithData, "build_ext": BuildKernels}, ext_modules=kernels())
