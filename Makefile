# make install   what a run needs, into .venv        make test       checks and tests: minutes
# make check     style, types, imports               make test-all   all that follows too: hours
# make lift      one lift of a can, emulated         make test-nightly  slow tests, kills, a lab's day
# make bench     measurements, as ratios             make test-train    what needs torch
# make faults    every fault at every phase of a lift; writes docs/faults.md
# make mutants   what the tests would not see; writes docs/mutants.md     make soak  an hour of lifts
# make fuzz      an hour of hostile clients on every port of an emulated cell (MINUTES=, SEED=)
# make lock      renew requirements/*.txt (with uv)  make test-cluster  what needs Dask
# make clean     remove what make made               make test-browser  pages, in a Chromium
# make docs      the site, into build/site           make install-charts, -train, -cluster  extras
#
# PYTHON=/path/to/python picks the interpreter of a new .venv.

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
MAKEFLAGS += --no-builtin-rules

export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_NO_INPUT := 1
# An activated environment or a stray PYTHONPATH must not leak into .venv.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV

BIN := .venv/bin
PIP := $(BIN)/python -m pip install -qq
MADE := .venv/.made-in
BASE := .venv/.installed-base
DEV := .venv/.installed-dev
TRAIN := .venv/.installed-train
CLUSTER := .venv/.installed-cluster
CHARTS := .venv/.installed-charts
DOCS := .venv/.installed-docs
PYTHON ?= python3.12 python3.11 python3
OBJECT ?= can

.PHONY: install install-dev install-charts install-train install-cluster docs lift test test-unit test-wire test-all test-nightly \
        faults mutants soak test-train test-cluster test-browser bench fuzz check check-style check-types check-imports lock clean

install: $(BASE)
install-dev: $(DEV)
install-charts: $(CHARTS)
install-train: $(TRAIN)
install-cluster: $(CLUSTER)

# A name on the PATH proves nothing (a version manager leaves names that only print an error), so
# each candidate is run. The stamp holds the checkout's path: a copied .venv would run the original.
ifneq "$(shell test -x $(BIN)/python && cat $(MADE) 2>/dev/null)" "$(CURDIR)"
.PHONY: $(MADE)
endif
$(MADE):
	@rm -rf .venv
	@for python in $(PYTHON); do \
	  if "$$python" -c 'import sys, venv, ensurepip; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 13))' 2>/dev/null; then \
	    echo "creating .venv with $$("$$python" --version)"; \
	    "$$python" -m venv .venv; \
	    printf '%s\n' "$(CURDIR)" > $@; \
	    exit 0; \
	  fi; \
	done; \
	echo "make: no usable Python 3.11 or 3.12 with venv found; install one (on Debian: apt-get install python3.11-venv) or name it with make PYTHON=/path/to/python3.12" >&2; \
	exit 1

# Stamps are touched last: an install that fails leaves none, and the next make tries again.
$(BASE): $(MADE) requirements/base.txt pyproject.toml
	@echo "installing requirements/base.txt"
	@$(PIP) --require-hashes -r requirements/base.txt
	@$(PIP) --no-deps --no-build-isolation -e .
	@touch $@

$(DEV): $(BASE) requirements/dev.txt
	@echo "installing requirements/dev.txt"
	@$(PIP) --require-hashes -r requirements/dev.txt
	@touch $@

# torch's file differs from place to place (CPU or CUDA build), so it has a version and no hash.
$(TRAIN): $(DEV) requirements/train.txt
	@echo "installing requirements/train.txt"
	@$(PIP) -r requirements/train.txt
	@touch $@

$(CLUSTER): $(DEV) requirements/cluster.txt
	@echo "installing requirements/cluster.txt"
	@$(PIP) --require-hashes -r requirements/cluster.txt
	@touch $@

$(CHARTS): $(BASE) requirements/charts.txt
	@echo "installing requirements/charts.txt"
	@$(PIP) --require-hashes -r requirements/charts.txt
	@touch $@

$(DOCS): $(BASE) requirements/docs.txt
	@echo "installing requirements/docs.txt"
	@$(PIP) --require-hashes -r requirements/docs.txt
	@touch $@

# warnings are errors (mkdocs.yml); nothing of ours is run, docstrings are read
docs: $(DOCS)
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -P -m mkdocs build --strict --clean
	@echo "$(CURDIR)/build/site/index.html"

lift: install
	$(BIN)/grasp run lift --object $(OBJECT) --report

# lint-imports' cache keeps old answers when a module is new; without it takes no longer
check: install-dev
	@$(MAKE) --no-print-directory --jobs --output-sync check-style check-types check-imports
check-style:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
check-types:
	$(BIN)/mypy
check-imports:
	$(BIN)/lint-imports --no-logo --no-cache

# One worker more than there are cores: tests on wires wait for real time, and compute little.
WORKERS ?= $(shell cores=$$(nproc); echo $$((cores < 8 ? cores + 1 : 8)))
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal
test: check
	$(PYTEST)
test-unit: install-dev
	$(PYTEST) tests/unit
test-wire: install-dev
	$(PYTEST) tests/wire

# each lane has its own target
LANES := test-nightly test-browser test-cluster test-train
test-all:
	@$(MAKE) --no-print-directory --jobs=1 --keep-going test $(LANES)
test-nightly: install-dev
	$(PYTEST) -m slow --ignore tests/nightly/test_cluster.py --ignore tests/wire/scenarios/chaos

test-train: install-train
	$(BIN)/python -m pytest -m train

# without Chromium (on Debian: apt-get install chromium) they skip and say so
test-browser: install-dev
	$(BIN)/python -m pytest -m browser tests/browser

test-cluster: install-cluster
	$(BIN)/python -m pytest -m slow tests/nightly/test_cluster.py

# what is lacking is run, and what was ended goes on: two hours of an idle core; then lifts through
# wires that are spoilt, in wall time: three quarters of an hour
JOBS ?= $(shell nproc)
faults: install-dev
	fell=0; $(BIN)/python scripts/faults.py run --stale --jobs $(JOBS) || fell=$$?; test $$fell -lt 2 || exit $$fell; \
	$(BIN)/python scripts/faults.py page || fell=$$?; \
	CHAOS_PLANS=200 $(BIN)/python -m pytest -s -m slow tests/wire/scenarios/chaos || fell=$$?; \
	exit $$fell

# each mutant of what safety rests on, and samples of the rest by this seed, that of docs/mutants.md
MUTANTS_SEED ?= 17
mutants: install-dev
	lived=0; $(BIN)/python scripts/mutants.py run || lived=$$?; test $$lived -lt 2 || exit $$lived; \
	$(BIN)/python scripts/mutants.py sample --seed $(MUTANTS_SEED) || lived=$$?; test $$lived -lt 2 || exit $$lived; \
	$(BIN)/python scripts/mutants.py twice || lived=$$?; test $$lived -lt 2 || exit $$lived; \
	$(BIN)/python scripts/mutants.py page && exit $$lived

soak: install-dev
	$(BIN)/python scripts/soak.py run

MINUTES ?= 60
SEED ?= 1
fuzz: install-dev
	$(BIN)/python -m tests.wire.fuzz.campaign --minutes $(MINUTES) --seed $(SEED)

bench: install-dev
	$(BIN)/python -m pytest -m bench -s

# One resolution for both Pythons; base is held to what dev found, train to both.
UV ?= uv
COMPILE := $(UV) pip compile --quiet --upgrade --universal --python-version 3.11 --fork-strategy fewest --no-header
lock:
	@command -v $(UV) >/dev/null || { echo "make lock needs uv: pip install uv, or make lock UV=/path/to/uv" >&2; exit 1; }
	$(COMPILE) --generate-hashes --extra charts --extra dev --group build pyproject.toml -o requirements/dev.txt
	$(COMPILE) --generate-hashes --group build pyproject.toml -c requirements/dev.txt -o requirements/base.txt
	$(COMPILE) --generate-hashes --extra charts --group build pyproject.toml -c requirements/dev.txt -o requirements/charts.txt
	$(COMPILE) --generate-hashes requirements/docs.in -c requirements/dev.txt -o requirements/docs.txt
	$(COMPILE) --generate-hashes --extra cluster --group build pyproject.toml -c requirements/dev.txt -o requirements/cluster.txt
	$(COMPILE) requirements/train.in -c requirements/dev.txt -o requirements/train.txt
	printf 'torch==2.13.0\n' >> requirements/train.txt

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache build dist
	find grasp drivers detector scenarios scripts tests -name __pycache__ -type d -prune -exec rm -rf {} +
