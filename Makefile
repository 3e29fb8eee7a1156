# flexarm: everything runs from here. Needs Python 3.11 or later and make; the rest goes into .venv.

PYTHON ?= python3
WORKERS ?= 2
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# Threads of numerical libraries would compete with the test workers. Figures go to files, not to a screen.
export OMP_NUM_THREADS ?= 1
export OPENBLAS_NUM_THREADS ?= 1
export MPLBACKEND ?= Agg

.PHONY: help setup demo test test-slow test-full test-all lint format bench proof docs lock clean
.DEFAULT_GOAL := help

help:
	@echo "make setup      create .venv and install flexarm with its tools"
	@echo "make demo       run the demonstration; results go to ./demo-results"
	@echo "make test       ruff, mypy, import-linter and the quick tests"
	@echo "make test-slow  the slow tests alone"
	@echo "make test-full  make test and make test-slow in one"
	@echo "make test-all   the quick tests on every supported Python that is found, 3.11 to 3.13; STRICT=1 fails on a missing one"
	@echo "make lint       ruff, mypy and import-linter alone"
	@echo "make format     let ruff format and repair"
	@echo "make bench      run benchmarks/bench_*.py"
	@echo "make proof      conceal effects, find them again: 8 cases into ./proof-results; FULL=1 for all, into docs/proof.md"
	@echo "make rigs       the same on 10 random rigs into ./proof-results/rigs; FULL=1 for 300 and ten hard cases, into docs/random-rigs.md"
	@echo "make docs       build the documentation into ./site"
	@echo "make lock       resolve the dependencies again and write requirements.lock"
	@echo "make clean      remove caches, builds and results; keeps .venv"
	@echo "Variables: PYTHON (now $(PYTHON)), WORKERS (parallel tests, now $(WORKERS))"

setup: $(READY)
	@echo "$(VENV) is ready"

$(READY): pyproject.toml requirements.lock tools/install.py
	@$(PYTHON) tools/install.py $(VENV) -c requirements.lock -e ".[dev,docs]"
	@touch $@

demo: $(READY)
	@$(BIN)/python -m flexarm.demo

lint: $(READY)
	@echo "== ruff check";  $(BIN)/ruff check .
	@echo "== ruff format"; $(BIN)/ruff format --check .
	@echo "== mypy";        $(BIN)/mypy
	@echo "== import floors"; $(BIN)/lint-imports > $(VENV)/lint-imports.log 2>&1 \
		&& tail -n 1 $(VENV)/lint-imports.log || { cat $(VENV)/lint-imports.log; exit 1; }

test: lint
	@echo "== pytest"; $(BIN)/pytest -n $(WORKERS)

test-full: lint
	@echo "== pytest, slow tests included"; $(BIN)/pytest -n $(WORKERS) -m "slow or not slow"

test-slow: $(READY)
	@echo "== pytest, slow tests alone"; $(BIN)/pytest -n $(WORKERS) -m slow

# Each version has an environment of its own, .venv-3.11 and so on; what is not found is named at the end.
test-all: $(READY)
	@$(BIN)/python tools/matrix.py $(if $(STRICT),--strict) -n $(WORKERS)

format: $(READY)
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

bench: $(READY)
	@for file in benchmarks/bench_*.py; do echo "== $$file"; $(BIN)/python "$$file" || exit 1; done

# The full form takes its seeds from the commit that froze the rules, and needs hours; both go on where they were stopped.
proof: $(READY)
ifdef FULL
	@$(BIN)/python -m benchmarks.proof run all --frozen --workers $(WORKERS) -o proof-results
	@$(BIN)/python -m benchmarks.proof settle --workers $(WORKERS) -o proof-results
	@$(BIN)/python -m benchmarks.proof page -o proof-results
else
	@$(BIN)/python -m benchmarks.proof run quick --workers $(WORKERS) -o proof-results/quick
	@$(BIN)/python -m benchmarks.proof page -o proof-results/quick --page proof-results/quick/proof.md \
		--data proof-results/quick/proof.json
endif

# Random rigs; SEEDS="0 1 2". The full form is as of `proof`.
SEEDS ?= $(shell seq 0 9)
.PHONY: rigs
rigs: $(READY)
ifdef FULL
	@$(BIN)/python -m benchmarks.proof run rigs --frozen --count 300 --longest 300 --workers $(WORKERS) -o proof-results/full-rigs
	@$(BIN)/python -m benchmarks.proof run hard --seeds 0 --longest 300 --workers $(WORKERS) -o proof-results/full-rigs
	@$(BIN)/python -m benchmarks.proof rigs -o proof-results/full-rigs
else
	@$(BIN)/python -m benchmarks.proof run rigs --seeds $(SEEDS) --longest 300 --workers $(WORKERS) -o proof-results/rigs
	@$(BIN)/python -m benchmarks.proof rigs -o proof-results/rigs --page proof-results/rigs/random-rigs.md \
		--data proof-results/rigs/random-rigs.json
endif

docs: $(READY)
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet && echo "documentation: site/index.html"

lock:
	@$(PYTHON) tools/lock.py

clean:
	@rm -rf build dist site .docs-cache demo-results proof-results/quick .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	@find . -path './$(VENV)*' -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
