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
QUICK := $(VENV)/.quick
READY := $(VENV)/.ready
# CommonRoad's reader and planner, for tests: in a folder of their own, because the protobuf that they insist on is no other's.
COMMONROAD := tests/bridges/commonroad/commonroad.lock
# CommonRoad's monitor, likewise: what it needs beside these.
JUDGE := tests/bridges/commonroad/judge.lock

.PHONY: run test test-slow results pages results-again submissions board floor holdout train docs film site-pictures torture mirrored mutation judge second-judge base setup lock package release manifest picture lint format maps scenarios next edition golden bench clean

run: base
	$(BIN)/tsbench run --planner idm --planner idm-e --split test --variants 0 --trace violations \
		--workers $(WORKERS) --out runs/main

# All tests but the slow ones, which take more than ten seconds each, or need torch, Ray or a browser: those are `make test-slow`.
# TEST_ARGS: for example tests/rules, or "-k stop".
# One thread a process: more wait for each other by spinning, and there are as many processes as cores. What is compiled is kept,
# whatever the shell says: hundreds of processes import tsbench.
PYTEST := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n $(WORKERS) --dist worksteal
test: $(QUICK)
	$(PYTEST) $(TEST_ARGS)

test-slow: setup
	$(PYTEST) -m "slow and not torture and not whole and not submissions" $(TEST_ARGS)

# The campaign of results/campaign.yaml (docs/run.md, "Campaigns"): its runs and analyses, the tables and figures of PAGES, and the
# report. Goes on where it was stopped. The tables of the runs in `results` come with the repository; RESULTS=runs/mine drives everything
# anew. `pages` drives nothing. A trial: ARGS="--types stop,speed --limit 4" RESULTS=/tmp/trial PAGES="copies of pages".
RESULTS := results
PAGES := docs/results.md docs/report.md docs/floor.md docs/contrast.md README.md
METADRIVE := $(RESULTS)/metadrive_simulator-0.4.3-py3-none-any.whl
# CommonRoad's packages beside what PYTHONPATH names already, and MetaDrive's wheel.
WITH_OTHERS = PYTHONPATH=$(VENV)/commonroad$${PYTHONPATH:+:$$PYTHONPATH} TSBENCH_METADRIVE=$(METADRIVE)
results: $(METADRIVE)
results pages: setup
	$(WITH_OTHERS) $(BIN)/tsbench campaign results/campaign.yaml --out $(RESULTS) $(if $(filter pages,$@),--no-drive,--workers $(WORKERS)) $(ARGS)
	$(BIN)/tsbench analyse pages $(PAGES) --from $(RESULTS)/analyses
	$(BIN)/tsbench report $(addprefix $(RESULTS)/,styles networks plant2-ft) --out $(RESULTS)/report.html

$(METADRIVE): $(READY)
	$(PIP) download --no-deps --dest $(RESULTS) metadrive-simulator==0.4.3

# A random SHARE of each planner's episodes of `make results` driven again; a refuted one ends it. SEED: your own.
SHARE ?= 54
results-again: setup $(METADRIVE)
	for run in $$(dirname $(RESULTS)/*/run.json); do \
		$(WITH_OTHERS) $(BIN)/tsbench verify $$run --shared-process --sample $(SHARE) --seed $(SEED) --workers $(WORKERS) || [ $$? = 3 ] || exit; done

# tsbench's expert, its network and a planner in C: driven isolated, submitted, verified as on another processor; forgeries of each.
submissions: setup
	$(BIN)/pytest -m "submissions or not submissions" -n $(WORKERS) --dist loadscope tests/board/test_submissions_driven.py

# The pictures of docs/leaderboard.md: the rows of results/board.yaml, two of them verified.
BOARD := runs/board
board: setup
	$(BIN)/tsbench campaign results/board.yaml --out $(BOARD) --workers $(WORKERS)
	mkdir -p $(BOARD)/rows
	for run in $$(dirname $(BOARD)/*/run.json); do \
		$(BIN)/tsbench submit $$run --authors tsbench --copy-traces 12 --out $(BOARD)/rows/$$(basename $$run).json || exit; done
	for planner in idm-e plant2-ft; do $(BIN)/tsbench verify $(BOARD)/rows/$$planner.json --sample 30 --seed 20261 --by "a reader" \
		--workers $(WORKERS) --out $(BOARD)/rows/$$planner.reader.json || exit; done
	$(BIN)/tsbench leaderboard build $(BOARD)/rows --out $(BOARD)/site
	PYTHONPATH=tests/helpers $(BIN)/python packaging/leaderboard_pictures.py $(BOARD)/site docs/images

# The campaigns of results/floor.yaml and results/holdout.yaml, into their pages.
floor holdout: setup
	$(BIN)/tsbench campaign results/$@.yaml --workers $(WORKERS)
	$(BIN)/tsbench analyse pages docs/$@.md --from runs/$@/analyses

# A network of every kind that comes with tsbench, one after the other, in TRAIN (docs/training.md). Goes on where it was stopped.
TRAIN ?= runs/train
SEED ?= 0
SIZE ?= mini
DEVICE ?= cpu
train: setup
	PATH=$(BIN):$$PATH sh packaging/train_networks.sh $(TRAIN) $(SEED) $(SIZE) $(DEVICE)

# Runs killed at fifty random moments and continued: the same bytes, nothing left behind. Takes ten minutes or so.
torture: setup
	$(BIN)/pytest -m torture -rP tests/run/test_torture.py

# Every test map's drive against its image in the mirror, tick by tick. Takes twenty minutes or so on two cores.
mirrored: setup
	$(BIN)/pytest -n $(WORKERS) --dist worksteal -m whole -rP tests/scenarios/test_mirror_whole.py

# Are the rules' tests strict enough? Mutants of the rules, and of what of roads they judge by; goes on where it was stopped.
mutation: $(BIN)/mutmut
	rm -rf $(addprefix mutants/,tests sign_catalog scenarios cities sumo_nets)  # copies, to which mutmut only adds
	mkdir -p mutants/scenarios mutants/cities
	$(BIN)/mutmut run --max-children $(WORKERS)
	$(BIN)/mutmut results --all true | $(BIN)/python tests/rules/mutation_table.py

$(BIN)/mutmut: $(READY)
	$(call install,mutation)
	touch $@

# Speed and stop episodes before a judge that others wrote, docs/second_judge.md.
JUDGED := runs/judged
second-judge: judge
	$(BIN)/tsbench run --split dev --types stop,speed --planner idm --planner idm-e --planner tsbench.make.certify.lawless:Lawless --trace all --workers $(WORKERS) --out $(JUDGED)
	PYTHONPATH=$(VENV)/judge:$(VENV)/commonroad $(BIN)/python -m tsbench.bridges.second_judge $(JUDGED)

judge: $(VENV)/judge/.ready

$(VENV)/judge/.ready: $(JUDGE) $(READY)
	$(PIP) install --require-hashes --no-deps --upgrade --target $(VENV)/judge --requirement $(JUDGE)
	touch $@

# `base`: what a run needs, and the extras that EXTRAS names (EXTRAS="report video"). QUICK: what `make test` needs besides.
# `setup`: all that slow tests and other targets need. Every package has the version and a hash that
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

$(QUICK): $(BASE)
	$(call install,report make dev)
	touch $@

setup: $(READY)

# torch first and alone: among builds whose hashes it knows, pip takes PyPI's with CUDA (3 GB with what that needs), also
# where an index nearer by has the one without. Its version is the lock file's, and so is all that it needs.
$(READY): $(QUICK) $(COMMONROAD)
	$(PIP) install --no-deps "$$(grep -o '^torch==[^ ]*' requirements.lock)"
	$(call install,video learn ray mcap docs release dev-slow)
	$(PIP) install --require-hashes --no-deps --upgrade --target $(VENV)/commonroad --requirement $(COMMONROAD) || \
		echo "CommonRoad's packages cannot be had here ($(COMMONROAD)): its planner is not driven, and its tests are skipped" >&2
	touch $@

# The lock files anew from what is asked for, with as few other versions as can be; UPGRADE=--upgrade: with the newest.
UV := build/uv/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes $(UPGRADE) \
	--custom-compile-command "make lock"
lock:
	$(PYTHON) -m venv build/uv
	build/uv/bin/python -m pip install --quiet --disable-pip-version-check uv==0.13.9
	$(UV) $(addprefix --extra ,report video make learn ray mcap docs release dev dev-slow mutation build) pyproject.toml -o requirements.lock
	$(UV) --no-deps $(COMMONROAD:.lock=.in) -o $(COMMONROAD)
	$(UV) --no-deps $(JUDGE:.lock=.in) -o $(JUDGE)

# The documentation as a site in build/site (with --quiet it would not count warnings as errors); its search works once it is served: python3 -m http.server -d build/site
docs: setup
	rm -rf build/signs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

# The film at the top of README.md: both halves of a pair of the dev split, as two planners drive them.
FILM := runs/film
FILMED := idm plant2-ft
film: setup
	$(BIN)/tsbench run $(addprefix --planner ,$(FILMED)) --split dev --types yield --variants 0 --trace all --workers $(WORKERS) --out $(FILM)
	$(BIN)/python packaging/pair_film.py $(FILM) yield-j-msk-9109661741-v0 docs/images/pair.gif $(FILMED)

# Pictures of the site for docs/install.md, in Chromium.
site-pictures: docs
	PYTHONPATH=tests/helpers $(BIN)/python packaging/site_pictures.py build/site docs/images

# Two wheels in dist/, and in dist/data the folder that `tsbench data fetch --from` reads, here or behind an address.
package: base
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
	PYTHONPATH=.:tests/helpers $(BIN)/python packaging/architecture_picture.py

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

# Scenes of the next edition, in pieces (docs/editions.md): make next SPLIT=test TYPES=yield,stop
next: setup
	mkdir -p next/scenarios
	ln -sfn ../cities ../sign_catalog ../sumo_nets next/
	ln -sfn $(addprefix ../../scenarios/,recipes editions.yaml nuplan_statistics.json oracle.json) next/scenarios/
	TSBENCH_DATA=next $(BIN)/tsbench scenarios build --split $(SPLIT) --types $(TYPES) --osm $(OSM) --workers $(WORKERS)

# The contracts of this tsbench under the name of its edition (docs/editions.md).
edition: setup
	$(BIN)/python -m tsbench.run.edition
	$(BIN)/python packaging/data_sets.py manifest

# The bytes that SCORING stands for (tests/test_golden.py), once it is raised.
golden: setup
	$(BIN)/python tests/test_golden.py

bench: base
	$(BIN)/tsbench bench

clean:
	rm -rf $(VENV) .mypy_cache .ruff_cache .pytest_cache mutants build dist
