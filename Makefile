# Everything runs in a virtual environment of its own, .venv; nothing is needed but Python 3.11+ and make.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
PIP    := -m pip install --quiet --disable-pip-version-check --no-compile
# One process more than there are cores: some tests wait for a vehicle, which needs no core.
PYTEST = $(BIN)/python -m pytest --numprocesses $(shell $(PYTHON) -c 'import os; print(min(os.cpu_count() + 1, 8))') --dist loadfile --no-loadscope-reorder --durations 10

# What is imported is compiled then, once: of all that is installed, which takes as long again, that is little.
# Without bytecode each of the many processes of the tests would compile it anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo demo-live test test-all lint check fuzz bench format clean

demo: $(VENV)/.installed  ## the bundled flight in the browser
	$(BIN)/companion view demo --open

demo-live: $(VENV)/.installed  ## a simulated vehicle on a link, live in the browser; Ctrl-C ends both
	@$(BIN)/companion simulate udpout:127.0.0.1:14550 --duration 1200 & vehicle=$$!; \
		trap 'kill $$vehicle 2>/dev/null; wait $$vehicle' EXIT; trap : INT TERM; \
		$(BIN)/companion view udpin:127.0.0.1:14550 --open -o "$${TMPDIR:-/tmp}/companion-live-$$$$.tlog"

test: $(VENV)/.developer  ## the tests but for the long ones, on every core
	$(PYTEST) -m "not long"

test-all: $(VENV)/.developer  ## every test: half an hour on two cores
	$(PYTEST)

lint: $(VENV)/.developer  ## format, lint, types
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

check: lint test  ## what CI holds

fuzz: $(VENV)/.developer  ## every reader against damaged input, SECONDS (600) for each, on two seeds
	$(BIN)/python -m tests.fuzz --seconds $(or $(SECONDS),600) --seed 1
	$(BIN)/python -m tests.fuzz --seconds $(or $(SECONDS),600) --seed 2

bench: $(VENV)-bench/.installed  ## speed, as ratios against named peers
	for benchmark in benchmarks/*.py; do $(VENV)-bench/bin/python $$benchmark || exit 1; done

format: $(VENV)/.developer  ## put the source in order
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) $(VENV)-bench dist .pytest_cache .mypy_cache .ruff_cache

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "companion needs Python 3.11 or newer; name it: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python $(PIP) --editable '.[all]'
	touch $@

$(VENV)-bench/.installed: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m venv $(VENV)-bench
	$(VENV)-bench/bin/python $(PIP) --editable '.[bench]'
	touch $@

$(VENV)/.developer: pyproject.toml | $(VENV)/bin/python
	$(BIN)/python $(PIP) --editable '.[dev]'
	$(BIN)/python $(PIP) --no-deps 'MAVProxy>=1.8.75'  # the libraries of its 3D map are a gigabyte
	touch $@ $(VENV)/.installed
