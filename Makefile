# make demo and make test do all their own set-up: Python 3.11 and make are enough.
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEMO_STAMP := $(VENV)/.installed-for-demo

.PHONY: demo test check bench soak docs-figures fault-matrix mutate replay-update clean

demo: $(DEMO_STAMP)
	$(BIN)/flightd demo

test: $(STAMP)
	$(BIN)/pytest -n 3 --dist worksteal

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: $(STAMP)
	$(BIN)/flightd bench loop --rounds 3 --against docs/measurements-loop.json

# The long forms of what CI runs short: hostile lines, crowds of clients, thousands of goals, a flood while flying (a
# minute, quiet and flooded side by side), a thousand preemptions.
soak: $(STAMP)
	FLIGHTD_SOAK=100 $(BIN)/pytest -s tests/process/test_socket_soak.py tests/process/test_socket_flood.py tests/closed_loop/test_preemptions.py
	$(BIN)/flightd bench goals --count 10000

# Flies every fault and writes the measured responses, and the supervisor's diagram, into the document.
fault-matrix: $(STAMP)
	PYTHONPATH=tests $(BIN)/python -m support.fault_table docs/safety.md

# Mutation testing of what keeps the vehicle safe: an hour or more on one core. MODULE=daemon/frames.py names one,
# SAMPLE=60 tries so many mutants of each.
MODULE ?= daemon/safety daemon/control daemon/frames.py daemon/pipeline.py
SAMPLE ?= 0
mutate: $(STAMP)
	$(BIN)/pip install --quiet 'cosmic-ray>=8.3,<9'
	PYTHONPATH=.:tests nice -n 19 $(BIN)/python -m support.mutate $(MODULE) --sample $(SAMPLE)

# Flies each kind of goal in virtual time and draws the pictures of docs/guidance.md.
docs-figures: $(STAMP)
	PYTHONPATH=tests $(BIN)/python docs/figures/guidance.py

# On purpose only: the flow is meant to answer differently from now on.
replay-update: $(STAMP)
	PYTHONPATH=tests $(BIN)/python tests/replay/references.py

$(VENV)/.made:
	$(PYTHON) -m venv $(VENV) || python3 -m venv $(VENV)
	$(BIN)/python -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed")'
	$(BIN)/pip install --quiet --upgrade pip
	touch $@

# Without what the tests and checks need, some of which has to be compiled on ARM.
$(DEMO_STAMP): pyproject.toml | $(VENV)/.made
	$(BIN)/pip install --quiet --editable '.[sim,report]'
	touch $@

$(STAMP): pyproject.toml | $(VENV)/.made
	$(BIN)/pip install --quiet --editable '.[dev]'
	touch $@

clean:
	rm -rf $(VENV) build dist flight-report .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
