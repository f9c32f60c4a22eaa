# `make run` and `make test` set everything up by themselves. Other targets regenerate data or check the code.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
WORKERS ?= 2
OSM ?= sumo_nets/sources
EXTRAS ?=
empty :=
# Other extras are another target, or they would not be added to what is there.
BASE := $(VENV)/.base$(subst $(empty) ,,$(EXTRAS:%=-%))
READY := $(VENV)/.ready
# CommonRoad's reader, for a test: in a folder of its own, because the protobuf that it insists on is no other's.
COMMONROAD := tests/report/export/commonroad.lock

.PHONY: run test results floor train docs torture mutation base setup lock package release manifest picture lint format maps scenarios edition bench clean

run: base
	$(BIN)/tsbench run --planner idm --planner idm-e --split test --variants 0 --trace violations \
		--workers $(WORKERS) --out runs/main

# A part for each folder, with workers of its own, or every one would hold what draws and what learns beside all else:
# they stay below 700 MB (tests/helpers/memory_guard.py).
TESTS := $(filter-out %/__pycache__/ %/cases/ %/helpers/ %/learn/,$(wildcard tests/*/ tests/learn/*/))
PYTEST = $(BIN)/pytest -n $(WORKERS) --dist worksteal
test: setup
	for part in $(TESTS) "$(wildcard tests/test_*.py tests/learn/test_*.py)"; do $(PYTEST) $$part || exit; done

# All planners on one scene of each test map, plant2-ft once more with signs masked, the analyses, their tables and figures
# in docs/results.md, and the report. Goes on where it was stopped. VARIANTS=all: on all test scenes,
# into docs/results-all.md; only plant2-ft's failures are traced: docs/cluster.md says what all traces would take.
VARIANTS ?= one-per-map
RESULTS := runs/results-$(VARIANTS)
BASES := idm idm-s1 idm-s2 idm-s3 idm-s4 ppo carl plant2
PLANNERS := $(BASES) $(addsuffix -e,$(BASES))
TRACE := $(if $(filter all,$(VARIANTS)),none,violations)
PAGES := $(if $(filter all,$(VARIANTS)),docs/results-all.md,docs/results.md)
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

# What a driver gets who reads no plate: the floors beside others on one pair of each test map, into docs/floor.md, README.md.
# VARIANTS=all: on all test scenes. Goes on where it was stopped.
FLOOR := runs/floor-$(VARIANTS)
floor: setup
	$(BIN)/tsbench run $(addprefix --planner ,blind coin plant2-blind idm idm-s1 tsbench.dataset.certify.lawless:Lawless plant2-ft idm-e) \
		--split test --variants $(VARIANTS) --trace none --workers $(WORKERS) --out $(FLOOR)
	$(BIN)/tsbench analyse floor $(FLOOR) --out $(FLOOR)/analyses
	$(BIN)/tsbench analyse pages docs/floor.md README.md --from $(FLOOR)/analyses

# A network of every kind that comes with tsbench, one after the other, in TRAIN (docs/training.md). Goes on where it was
# stopped. `plant2-ft` and `plant2-blind` begin with the `plant2` trained before them.
TRAIN ?= runs/train
SEED ?= 0
SIZE ?= mini
DEVICE ?= cpu
LESSONS := --planner idm-e --rate 3e-4 --validation 4 --seed $(SEED) --device $(DEVICE) --workers 1
train: setup
	$(BIN)/tsbench train plant2 --size $(SIZE) --episodes 2400 --epochs 5 --validation 48 --seed $(SEED) --device $(DEVICE) \
		--workers 1 --out $(TRAIN)/plant2
	$(BIN)/tsbench train plant2-ft --base $(TRAIN)/plant2 --drives 3480 --epochs 6 $(LESSONS) --out $(TRAIN)/plant2-ft-1
	$(BIN)/tsbench train plant2-ft --base $(TRAIN)/plant2-ft-1 --student $(TRAIN)/plant2-ft-1 --takeover 0.3 --drives 1200 \
		--more priority,obstacles --epochs 4 $(LESSONS) --rate 1.5e-4 --out $(TRAIN)/plant2-ft
	$(BIN)/tsbench train plant2-ft --mask-signs --base $(TRAIN)/plant2 --drives 1160 --epochs 8 $(LESSONS) \
		--out $(TRAIN)/plant2-blind
	$(BIN)/tsbench train ppo --steps 120000 --rate 1e-4 --imitation 40 --workers 6 --seed $(SEED) \
		--more detour_either,detour_left,detour_right --types priority,speed,routing,bus_lane,bike_lane,detour_either,detour_left,detour_right \
		--out $(TRAIN)/ppo
	$(BIN)/tsbench train carl --steps 410000 --rate 1.5e-4 --imitation 120 --workers 6 --more priority,detour_left --seed $(SEED) \
		--out $(TRAIN)/carl

# Runs killed at fifty random moments and continued: the same bytes, nothing left behind. Takes ten minutes or so.
torture: setup
	$(BIN)/pytest -m torture -rP tests/run/test_torture.py

# Are the rules' tests strict enough? Mutants of tsbench/rules against tests/rules; goes on where it was stopped.
mutation: $(BIN)/mutmut
	rm -rf mutants/tests mutants/sign_catalog  # copies, to which mutmut only adds
	$(BIN)/mutmut run --max-children $(WORKERS)
	$(BIN)/mutmut results --all true | $(BIN)/python tests/rules/mutation_table.py

$(BIN)/mutmut: $(READY)
	$(call install,mutation)
	touch $@

# `base`: what a run needs, and the extras that EXTRAS names (EXTRAS="report video"). `setup`: all that the tests need. Every package has the version and a hash that
# requirements.lock names; this pip is the first that takes hashes from a file of constraints.
PIP := $(BIN)/python -m pip --quiet --disable-pip-version-check
ASKED := import sys, tomllib; p = tomllib.load(open("pyproject.toml", "rb"))["project"]; \
	print(*p["dependencies"], *(r for e in sys.argv[1:] for r in p["optional-dependencies"][e]), sep="\n")
define install
	$(BIN)/python -c '$(ASKED)' $(1) > $(VENV)/asked.txt
	$(PIP) install --require-hashes --constraint requirements.lock --requirement $(VENV)/asked.txt
endef

base: $(BASE)

$(BASE): pyproject.toml requirements.lock
	$(PYTHON) -m venv $(VENV)
	$(PIP) install pip==26.3
	$(call install,build $(EXTRAS))
	$(PIP) install --no-deps --no-build-isolation --editable .
	touch $@

setup: $(READY)

# torch first and alone: among builds whose hashes it knows, pip takes PyPI's with CUDA (3 GB with what that needs), also
# where an index nearer by has the one without. Its version is the lock file's, and so is all that it needs.
$(READY): $(BASE) $(COMMONROAD)
	$(PIP) install --no-deps "$$(grep -o '^torch==[^ ]*' requirements.lock)"
	$(call install,report video make learn ray mcap docs release dev)
	$(PIP) install --require-hashes --no-deps --upgrade --target $(VENV)/commonroad --requirement $(COMMONROAD)
	touch $@

# The lock files anew from what is asked for, with as few other versions as can be; UPGRADE=--upgrade: with the newest.
UV := build/uv/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes $(UPGRADE) \
	--custom-compile-command "make lock"
lock:
	$(PYTHON) -m venv build/uv
	build/uv/bin/python -m pip install --quiet --disable-pip-version-check uv==0.13.9
	$(UV) $(addprefix --extra ,report video make learn ray mcap docs release dev mutation build) pyproject.toml -o requirements.lock
	$(UV) --no-deps $(COMMONROAD:.lock=.in) -o $(COMMONROAD)

# The documentation as a site in build/site (with --quiet it would not count warnings as errors); its search works once it is served: python3 -m http.server -d build/site
docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

# Two wheels in dist/, and in dist/data the folder that `tsbench data fetch --from` reads, here or behind an address.
package: setup
	rm -rf dist
	$(PIP) wheel --no-deps --no-build-isolation --wheel-dir dist . ./packaging/tsbench-data
	$(BIN)/python packaging/data_sets.py lay-out dist/data

# A release from TAG=v0.1.0 in dist/release: both wheels, data, the folder for a data set hub, metadata, checksums. It is
# installed and driven in an environment of its own; nothing is uploaded.
release: setup
	rm -rf dist/release
	PYTHONPATH=. $(BIN)/python packaging/release.py $(TAG) dist/release

# Sizes and SHA-256 of all data files anew, after data were made.
manifest: setup
	$(BIN)/python packaging/data_sets.py manifest

# Who imports whom, drawn from the code into docs/architecture.md.
picture: setup
	PYTHONPATH=. $(BIN)/python tests/helpers/import_graph.py

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

# At a release: the contracts of this tsbench under the name of its edition (docs/editions.md).
edition: setup
	$(BIN)/python -m tsbench.run.edition

bench: base
	$(BIN)/tsbench bench

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache mutants build dist
