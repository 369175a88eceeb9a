# make demo    installs into .venv, flies the first example, says where to watch it and where its report and its film are
# make test    installs into .venv, checks style and types, runs every test but the long campaigns
# make docs    renews the generated pages and builds the documentation site in site/
# make nightly runs the long campaigns
# make kernels compiles the formulas of arena/kernels again; the others do it when a formula has changed
# make thesis  flies the experiments of the thesis and prints its tables beside our figures; with PX4_HOME also on the real PX4
# make wheels  builds wheels for Linux x86_64 and aarch64 in dist/
# make bench   the benchmarks that need nothing else, as tables; px4, contract, tracking and thesis are commands of their own
PYTHON ?= python3
BIN := .venv/bin
# A file's tests share fixtures, so one worker runs them. The slowest files are first (tests/conftest.py).
SPREAD := --dist loadfile --no-loadscope-reorder
# Many containers set it. Then each process of an arena, and each worker of pytest, would compile its modules again.
export PYTHONDONTWRITEBYTECODE =

# `site` is also the name of a folder that it makes
.PHONY: demo test lint collected unit flights nightly bench thesis docs site kernels wheels clean

demo: bytecode
	$(BIN)/arena up examples/01_two_quads/arena.yaml --headless --until-done --time-limit 120 --monitor
	$(BIN)/arena render examples/01_two_quads --size 960x540 --fps 15

test:
	$(MAKE) --jobs=2 --output-sync=target lint site collected
	$(MAKE) unit flights

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/mypy

# pytest compiles the tests with its own asserts. The workers of the next runs find the result.
collected: bytecode
	-$(BIN)/python -m pytest --collect-only -q > /dev/null

# Half of the time, a unit test waits for a process or a socket: four workers for two cores.
unit: bytecode
	$(BIN)/python -m pytest -m "not flight and not crowd and not nightly" -n 4 $(SPREAD) -q

# Flights of a few vehicles mostly wait: four share two cores. Of arenas with many vehicles two do. Flights in real time that a
# neighbour on the cores would make fail are alone.
flights: bytecode
	$(BIN)/python -m pytest -m "flight and not crowd and not nightly and not alone" -n 4 $(SPREAD) -q
	$(BIN)/python -m pytest -m "crowd and not nightly and not alone" -n 2 $(SPREAD) -q
	$(BIN)/python -m pytest -m "alone and not nightly" -q

# Long campaigns: every cell of the process table, every shipped scenario, twelve vehicles, full fuzz and estimator campaigns.
nightly: bytecode
	$(BIN)/python -m pytest -m "nightly and not crowd" -n 2 --dist loadfile -q
	$(BIN)/python -m pytest -m "nightly and crowd" -q

bench: bytecode
	for each in flights world router startup; do $(BIN)/python benchmarks/$$each.py || exit 1; done

thesis: bytecode
	$(BIN)/python examples/thesis/fly.py

docs: .venv/ready
	$(BIN)/python -m arena.cli.reference
	$(MAKE) site

# The variable turns off an announcement of mkdocs-material. PYTHONPATH: mkdocs reads the docstrings of these sources.
site: .venv/ready
	NO_MKDOCS_2_WARNING=1 PYTHONPATH=$(CURDIR) $(BIN)/mkdocs build --quiet

kernels: .venv/compiled

bytecode: .venv/compiled
	$(BIN)/python -m compileall -q arena

# A tool that pip cannot install is named by the last command.
wheels: .venv/ready
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check ziglang auditwheel
	$(BIN)/python tools/build_wheels.py

.venv/compiled: .venv/ready setup.py $(wildcard arena/kernels/*.py arena/kernels/*.pxd arena/kernels/*.pyx)
	$(BIN)/python setup.py --quiet build_ext --inplace
	touch $@

.venv/ready: pyproject.toml
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("arena needs Python 3.11 or newer: make PYTHON=python3.11")'
	$(PYTHON) -m venv .venv
	# The formulas are compiled by the next target. --no-compile: Python compiles only the modules that it imports.
	ARENA_NO_COMPILE=1 $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[test]'
	# tested against too; of what it asks for, half a gigabyte of viewers, nothing is needed here
	-$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --no-deps 'MAVProxy>=1.8.70'
	touch $@

clean:
	rm -rf .venv build dist site arena/kernels/*.so runs examples/*/runs *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
