# Everything runs in a virtual environment of its own, made on first use.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
IN_PARALLEL := -q -n auto --maxprocesses 4 --dist worksteal  # each worker compiles a scene

.DEFAULT_GOAL := help
.PHONY: help install run test test-slow format check bench docs picture execution \
  reproduction clean

help:  ## List the targets.
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-13s %s\n", $$1, $$2}' Makefile

install: $(INSTALLED)  ## Make the virtual environment.

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 13))' \
	  || { echo "Python 3.11 or 3.12 is needed; try: make PYTHON=python3.11 $(MAKECMDGOALS)"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' \
	  || { echo "Python cannot make virtual environments; on Debian: apt-get install python3-venv"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

run: $(INSTALLED)  ## Teach the robot where the vase goes, and record it.
	$(BIN)/tablesetting run vase

test: $(INSTALLED)  ## Run the tests.
	$(BIN)/pytest $(IN_PARALLEL)

test-slow: $(INSTALLED)  ## Run the slow tests, too.
	$(BIN)/pytest $(IN_PARALLEL) -m "slow or not slow"

format: $(INSTALLED)  ## Format the code and mend what lint can.
	$(BIN)/ruff format
	$(BIN)/ruff check --fix

check: $(INSTALLED)  ## Check format, lint, types and layers.
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/mypy benchmarks/*.py
	$(BIN)/lint-imports

bench: $(INSTALLED)  ## Measure speed and memory.
	$(BIN)/python benchmarks/run.py

docs: $(INSTALLED)  ## Build the documentation, to docs/_build/index.html.
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[docs]'
	$(BIN)/sphinx-build -q -W --keep-going -b html docs docs/_build
	@echo "open docs/_build/index.html"

picture: $(INSTALLED)  ## Draw the pictures of a run and of the arm anew (needs Vulkan and EGL).
	$(BIN)/tablesetting run vase --seed 0 --out runs/picture --overwrite
	$(BIN)/tablesetting inspect runs/picture --screenshot docs/recording.png --at 11.7
	$(BIN)/python docs/draw_arm.py docs/arm.png

execution: $(INSTALLED)  ## Let the arm place things 400 times, and draw its figure anew.
	$(BIN)/tablesetting study execution --out runs/execution --overwrite
	cp runs/execution/figures/execution.png docs/execution_study.png

reproduction: $(INSTALLED)  ## Do the paper's table experiment, and draw its figure anew.
	$(BIN)/tablesetting study placement --out runs/reproduction --overwrite
	cp runs/reproduction/figures/placement.png docs/placement_study.png

clean:  ## Remove the virtual environment.
	rm -rf $(VENV)
