# Each target sets up its own environment in .venv and is safe to run again.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/ready

.PHONY: help demo lab test fuzz check-python clean

help:
	@echo "make demo   set up, then watch a robot do what a sentence says (half a minute after the installation)"
	@echo "make lab    set up, then open the notebooks in JupyterLab"
	@echo "make test   set up, then run ruff, the unit tests and every notebook"
	@echo "make fuzz   set up, then try ten thousand damaged files and a hundred thousand sentences (ten minutes)"
	@echo "make clean  remove the environment and what runs left behind"

check-python:
	@command -v $(PYTHON) >/dev/null 2>&1 || { \
	  echo "gem_lite needs Python 3.11 or newer, and '$(PYTHON)' was not found. Install it, or name yours: make demo PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "gem_lite needs Python 3.11 or newer; '$(PYTHON)' is $$($(PYTHON) -V 2>&1). Name another: make demo PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "'$(PYTHON)' cannot make virtual environments: install its venv package (on Debian and Ubuntu: python3-venv)."; exit 1; }

$(READY): environment.txt pyproject.toml | check-python
	@echo "Setting up $(VENV) with the versions in environment.txt (some minutes the first time) ..."
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r environment.txt || { \
	  echo "The installation failed: see the message above. Without a network or a package index it cannot work;"; \
	  echo "if pybullet had to be compiled, install a C++ compiler and Python's headers (on Debian and Ubuntu: build-essential python3-dev)."; exit 1; }
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@$(BIN)/python -c 'import cv2, pybullet, torch' >/dev/null || { \
	  echo "A package does not load: see the message above. It names the system library to install."; exit 1; }
	@touch $(READY)

demo: $(READY)
	@echo "Running the quickstart: a sentence in, a placed block out."
	@$(BIN)/python -m gem_lite.cli.demo

lab: $(READY)
	@echo "Opening the notebooks in JupyterLab; stop it with Ctrl-C."
	@$(BIN)/jupyter lab --notebook-dir=notebooks $(LAB_OPTIONS)

# Two files at a time, the longest first: the later lessons, and then the unit tests. One thread each, since two
# programs on two cores would wait for each other's. TEST_OPTIONS: more for pytest, such as --junitxml=report.xml.
WORKERS ?= 2
LESSONS := $(shell ls -r notebooks/*.ipynb)

test: $(READY)
	@echo "1/2 ruff"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@echo "2/2 notebooks and unit tests, $(WORKERS) files at a time"
	@OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses=$(WORKERS) --dist=loadfile --no-loadscope-reorder \
	  --nbval-lax $(TEST_OPTIONS) $(LESSONS) tests

fuzz: $(READY)
	@$(BIN)/python -m pytest tests/fuzz --hypothesis-profile=whole

clean:
	rm -rf $(VENV) runs .pytest_cache .ruff_cache *.egg-info
