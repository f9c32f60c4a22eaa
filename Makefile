# `make run` and `make test` set everything up by themselves. Other targets regenerate data or check the code.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
WORKERS ?= 2
OSM ?= sumo_nets/sources
READY := $(VENV)/.ready
# CommonRoad's reader, for a test: in a folder of its own, because the protobuf that it insists on is no other's.
COMMONROAD := tests/report/export/commonroad-requirements.txt

.PHONY: run test results torture mutation setup lint format maps scenarios bench clean

run: setup
	$(BIN)/tsbench run --planner idm --planner idm-e --split test --variants 0 --trace violations \
		--workers $(WORKERS) --out runs/main

# In two halves, or every worker would hold torch beside all else: they stay below 700 MB (tests/memory_guard.py).
WITHOUT := $(wildcard tests/learn/test_oracle_*.py) tests/learn/test_trajectories.py
WITH_TORCH := tests/envs tests/planners $(filter-out $(WITHOUT),$(wildcard tests/learn/test_*.py))
test: setup
	$(BIN)/pytest -n $(WORKERS) --dist worksteal $(addprefix --ignore=,$(WITH_TORCH))
	$(BIN)/pytest -n $(WORKERS) --dist worksteal $(WITH_TORCH)

# All planners on one scene of each test map, plant2-ft once more with signs masked, the analyses, their tables and figures
# in docs/results.md and README.md, and the report. Goes on where it was stopped. VARIANTS=all: on all 5,800 test scenes,
# into docs/results-all.md; only plant2-ft's failures are traced: traces of all planners would take 6 GB.
VARIANTS ?= one-per-map
RESULTS := runs/results-$(VARIANTS)
BASES := idm idm-s1 idm-s2 idm-s3 idm-s4 ppo carl plant2
PLANNERS := $(BASES) $(addsuffix -e,$(BASES))
TRACE := $(if $(filter all,$(VARIANTS)),none,violations)
PAGES := $(if $(filter all,$(VARIANTS)),docs/results-all.md,docs/results.md README.md)
RUNS := $(RESULTS)/others $(RESULTS)/plant2-ft
results: setup
	$(BIN)/tsbench run $(addprefix --planner ,$(PLANNERS)) --split test --variants $(VARIANTS) --trace $(TRACE) \
		--workers $(WORKERS) --out $(RESULTS)/others
	$(BIN)/tsbench run --planner plant2-ft --split test --variants $(VARIANTS) \
		--workers $(WORKERS) --out $(RESULTS)/plant2-ft
	$(BIN)/tsbench run --planner plant2-ft --split test --variants one-per-map --mask-signs --trace none \
		--workers $(WORKERS) --out runs/results-masked
	for name in main types intervals correlations failures; do \
		$(BIN)/tsbench analyse $$name $(RUNS) --out $(RESULTS)/analyses || exit; done
	$(BIN)/tsbench analyse ablation $(RESULTS)/plant2-ft runs/results-masked --out $(RESULTS)/analyses
	$(BIN)/tsbench analyse pages $(PAGES) --from $(RESULTS)/analyses
	$(BIN)/tsbench report $(RUNS) --out $(RESULTS)/report.html

# Runs killed at fifty random moments and continued: the same bytes, nothing left behind. Takes ten minutes or so.
torture: setup
	$(BIN)/pytest -m torture -rP tests/run/test_torture.py

# Are the rules' tests strict enough? Mutants of tsbench/rules against tests/rules; goes on where it was stopped.
mutation: $(BIN)/mutmut
	rm -rf mutants/tests mutants/sign_catalog  # copies, to which mutmut only adds
	$(BIN)/mutmut run --max-children $(WORKERS)
	$(BIN)/mutmut results --all true | $(BIN)/python tests/rules/mutation_table.py

$(BIN)/mutmut: $(READY)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[mutation]"
	touch $@

setup: $(READY)

$(READY): pyproject.toml constraints.txt $(COMMONROAD)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt torch
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[learn,ray,mcap,dev]"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --upgrade \
		--target $(VENV)/commonroad --requirement $(COMMONROAD)
	touch $@

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# The pool of maps from a folder of OSM extracts, then the scenario tables and scene files from the pool.
maps: setup
	$(BIN)/tsbench maps harvest --osm $(OSM) --workers $(WORKERS)

scenarios: setup
	$(BIN)/tsbench scenarios build --osm $(OSM) --workers $(WORKERS)
	$(BIN)/tsbench scenarios certify --workers $(WORKERS)
	$(BIN)/tsbench scenarios verify

bench: setup
	$(BIN)/tsbench bench

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache mutants
