# Each target sets up what it needs: python3 with venv, make and git are enough to begin with.
PYTHON ?= python3
VENV ?= .venv
RUN ?= runs/demo
PY := $(VENV)/bin/python
READY := $(VENV)/.ready
# One thread a process: the same result to the bit, and figures that mean something.
export OMP_NUM_THREADS ?= 1
export NUMBA_NUM_THREADS ?= 1

.PHONY: demo test slow lint bench setup clean help

help:
	@echo "make demo   the robot crosses the room; recording, pictures and figures in $(RUN)/"
	@echo "make test   the tests (a few minutes)      make slow   the long ones"
	@echo "make lint   ruff, mypy, import rules       make bench  speed and planners, as JSON"

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "simloop needs Python 3.11 or newer; try: make PYTHON=python3.12" >&2; exit 1; }
	@test -x $(PY) || $(PYTHON) -m venv $(VENV) || \
	  { echo "the venv module is missing; try: apt-get install python3-venv" >&2; exit 1; }
	@echo "installing simloop into $(VENV) (once, about two minutes)"
	@$(PY) -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[bench,dask,dev,references,report,slam]'
	@-$(PYTHON) scripts/rendering_libraries.py
	@touch $@

demo: $(READY)
	@$(VENV)/bin/simloop run experiment --out $(RUN)

test: $(READY)
	@$(PY) -m pytest -q -n auto

slow: $(READY)
	@$(PY) -m pytest -q -m slow

lint: $(READY)
	@$(PY) -m ruff check .
	@$(PY) -m mypy
	@$(VENV)/bin/lint-imports

bench: $(READY)
	@mkdir -p runs/bench
	@$(VENV)/bin/simloop bench loop --json runs/bench/loop.json
	@$(VENV)/bin/simloop bench planners --json runs/bench/planners.json

clean:
	rm -rf build dist runs .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find simloop tests -name __pycache__ -type d -prune -exec rm -rf {} +
