# Each target installs what it needs first. You need only python3 with venv, make and git.
PYTHON ?= python3
VENV ?= .venv
RUN ?= runs/demo
PY := $(VENV)/bin/python
READY := $(VENV)/.ready
# One thread in each process: results are the same to the bit, and timings can be compared.
export OMP_NUM_THREADS ?= 1
export NUMBA_NUM_THREADS ?= 1

.PHONY: demo test slow bounds lint bench setup clean help

help:
	@echo "make demo    drive the robot across the room; recording, pictures and figures in $(RUN)/"
	@echo "make test    run the tests (a few minutes)"
	@echo "make slow    run the long tests (many seeds)"
	@echo "make bounds  run the tests of compiled kernels with every index checked"
	@echo "make lint    check style, types and the rules of imports"
	@echo "make bench   measure speed and planners; figures as JSON in runs/bench/"
	@echo "make setup   install simloop into $(VENV)/ (the other targets do it when needed)"
	@echo "make clean   delete results, caches and build files"

setup: $(READY)

$(READY): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "simloop needs Python 3.11 or newer; name one with: make PYTHON=python3.12" >&2; exit 1; }
	@test -x $(PY) || $(PYTHON) -m venv $(VENV) || \
	  { echo "the Python module venv is missing; on Debian and Ubuntu: apt-get install python3-venv" >&2; exit 1; }
	@echo "installing simloop into $(VENV) (only once; takes about two minutes)"
	@$(PY) -m pip install --quiet --disable-pip-version-check \
	  --constraint constraints.txt --editable '.[bench,dask,dev,references,report,slam,worlds]'
	@-$(PYTHON) scripts/rendering_libraries.py
	@touch $@

demo: $(READY)
	@$(VENV)/bin/simloop run experiment --out $(RUN)

test: $(READY)
	@$(PY) -m pytest -q -n auto

slow: $(READY)
	@$(PY) -m pytest -q -m slow

# Code with checks must not get into the cache that all else uses.
bounds: $(READY)
	@NUMBA_BOUNDSCHECK=1 NUMBA_OPT=0 NUMBA_CACHE_DIR=build/bounds \
	  $(PY) -m pytest -q -W ignore tests/test_kernel_bounds.py \
	  tests/estimation/test_sight.py tests/estimation/test_map_drift.py \
	  tests/estimation/test_ekf_history.py tests/graph_slam/test_submap.py \
	  tests/evaluation/test_shortest_path.py::test_the_papers_four_obstacles \
	  tests/common/test_map_server.py tests/benchmarks/test_movingai_files.py

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
