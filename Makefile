# make install   what a run needs, into .venv        make test       checks and tests: minutes
# make check     style, types, imports               make test-all   every lane below: hours
# make lift      one lift of a can, emulated         make test-nightly  slow tests, kills, a lab's day
# make bench     measurements, as ratios             make test-train    what needs torch
# make test-faults    faults at moments of a lift, in virtual time (RUNS=, SEED=, FIRST_GRASP=touch)
# make test-chaos     lifts over wires that spoil what passes (PLANS=, FROM=)
# make test-soak      lifts on the emulated cell, one after the other (MINUTES=)
# make test-fuzz      hostile clients on every port of an emulated cell (MINUTES=, SEED=)
# make test-mutation  would the tests notice a changed line of the safety core?
# make test-studies   each study on a small grid
# make lock      renew requirements/*.txt (with uv)  make test-cluster  what needs Dask
#                                        make test-ros      the ROS 2 node, with rclpy
# make clean     remove what make made               make test-browser  pages, in a Chromium
# make results   every measured figure: docs/results.md and studies/results/*.csv (AGAIN=1, ONLY=PART, REAL=FILE, JOBS=2)
# make docs      the site, into build/site           make install-exports, -gym, -train, -cluster, -ros  extras
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
EXTRAS := dev exports gym train cluster ros docs
PYTHON ?= python3.12 python3.11 python3.13 python3
OBJECT ?= can

.PHONY: install $(EXTRAS:%=install-%) docs lift test test-all test-nightly test-faults test-chaos \
        test-soak test-fuzz test-mutation test-studies test-train test-cluster test-browser test-ros \
        bench results check check-style check-types check-imports check-size lock clean

install: $(BASE)
$(EXTRAS:%=install-%): install-%: .venv/.installed-%

# A name on the PATH proves nothing (a version manager leaves names that only print an error), so
# each candidate is run. The stamp holds the checkout's path: a copied .venv would run the original.
ifneq "$(shell test -x $(BIN)/python && cat $(MADE) 2>/dev/null)" "$(CURDIR)"
.PHONY: $(MADE)
endif
$(MADE):
	@rm -rf .venv
	@for python in $(PYTHON); do \
	  if "$$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
	    echo "creating .venv with $$("$$python" --version)"; \
	    "$$python" -m venv .venv; \
	    printf '%s\n' "$(CURDIR)" > $@; \
	    exit 0; \
	  fi; \
	done; \
	echo "make: no usable Python 3.11, 3.12 or 3.13 with venv found; install one (on Debian: apt-get install python3.11-venv) or name it with make PYTHON=/path/to/python3.12" >&2; \
	exit 1

# Stamps are touched last: an install that fails leaves none, and the next make tries again.
$(BASE): $(MADE) requirements/base.txt pyproject.toml
	@echo "installing requirements/base.txt"
	@$(PIP) --require-hashes -r requirements/base.txt
	@$(PIP) --no-deps --no-build-isolation -e .
	@$(BIN)/python -m grasp.cli.compiling
	@touch $@

# torch's file differs from place to place (CPU or CUDA build), so it has a version and no hash.
$(EXTRAS:%=.venv/.installed-%): .venv/.installed-%: requirements/%.txt $(BASE)
	@echo "installing $<"
	@$(PIP) $(if $(filter train,$*),,--require-hashes) -r $<
	@touch $@
$(patsubst %,.venv/.installed-%,train cluster ros): .venv/.installed-dev

# warnings are errors (mkdocs.yml); nothing of ours is run, docstrings are read
docs: install-docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -P -m mkdocs build --strict --clean
	@echo "$(CURDIR)/build/site/index.html"

# a short lift: the hand takes 1 s to activate, not 6, and the arm lifts by 10 cm, not 20
SHORT := --set hand.activation_s=1 --set controller.lift_height_m=0.1 --set controller.lower_speed_mps=0.1
lift: install
	@rig=emulated; \
	if ! $(BIN)/python -c 'import sys; from importlib.util import find_spec as find; sys.exit(not find("rtde_control"))'; then \
	  rig=simulated; \
	  echo "ur-rtde has no wheel for $$($(BIN)/python --version) on $$(uname -m): no emulated arm, so the lift is on the rig simulated"; \
	fi; \
	set -x; $(BIN)/grasp run lift --object $(OBJECT) $(SHORT) --rig $$rig --report

# lint-imports' cache keeps old answers when a module is new; without it takes no longer
check: install-dev
	@$(MAKE) --no-print-directory --jobs --output-sync check-style check-types check-imports check-size
check-style:
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
check-types:
	$(BIN)/mypy
check-imports:
	$(BIN)/lint-imports --no-logo --no-cache
check-size:
	$(BIN)/python -m tests.size

# One worker more than there are cores: tests on wires wait for real time, and compute little.
WORKERS ?= $(shell cores=$$(nproc); echo $$((cores < 8 ? cores + 1 : 8)))
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --dist worksteal
test: check
	$(PYTEST)

# each lane has its own target
LANES := test-nightly test-studies test-faults test-chaos test-soak test-fuzz test-mutation test-browser test-cluster test-ros test-train
test-all:
	@$(MAKE) --no-print-directory --jobs=1 --keep-going test $(LANES)
test-nightly: install-dev
	$(PYTEST) -m "slow and not nightly" --ignore tests/nightly/test_cluster.py

test-train: install-train
	$(BIN)/python -m pytest -m train

# without Chromium (on Debian: apt-get install chromium) they skip and say so
test-browser: install-dev
	$(BIN)/python -m pytest -m browser tests/browser

test-cluster: install-cluster
	$(BIN)/python -m pytest -m slow tests/nightly/test_cluster.py

test-ros: install-ros
	$(BIN)/python -m pytest -m ros tests/ros

# FROM, MINUTES, PLANS, RUNS and SEED reach the tests by the environment
NIGHTLY := $(BIN)/python -m pytest -s -m nightly tests/nightly
test-faults: install-dev
	$(NIGHTLY)/faults
test-chaos: install-dev
	$(NIGHTLY)/chaos
test-soak: install-dev
	$(NIGHTLY)/soak
test-fuzz: install-dev
	$(NIGHTLY)/fuzz
test-mutation: install-dev
	$(BIN)/python -m tests.nightly.mutation
test-studies: install-dev
	$(PYTEST) -m study tests/studies

bench: install-dev
	$(BIN)/python -m pytest -m bench -s

# runs the parts that are missing; AGAIN=1 runs all again, ONLY="campaign hands" these
results: install-dev
	$(BIN)/python -m studies results $(if $(AGAIN)$(ONLY),--again) $(if $(ONLY),--only $(ONLY)) $(if $(REAL),--real $(REAL)) $(if $(JOBS),--jobs $(JOBS))

# One resolution for all Pythons and platforms; base is held to what dev found, train to both.
UV ?= uv
COMPILE := $(UV) pip compile --quiet --upgrade --universal --python-version 3.11 --fork-strategy fewest --no-header
lock:
	@command -v $(UV) >/dev/null || { echo "make lock needs uv: pip install uv, or make lock UV=/path/to/uv" >&2; exit 1; }
	$(COMPILE) --generate-hashes --extra dev --group build pyproject.toml -o requirements/dev.txt
	$(COMPILE) --generate-hashes --group build pyproject.toml -c requirements/dev.txt -o requirements/base.txt
	$(COMPILE) --generate-hashes requirements/docs.in -c requirements/dev.txt -o requirements/docs.txt
	$(COMPILE) --generate-hashes --extra gym --group build pyproject.toml -c requirements/dev.txt -o requirements/gym.txt
	$(COMPILE) --generate-hashes --extra cluster --group build pyproject.toml -c requirements/dev.txt -o requirements/cluster.txt
	$(COMPILE) --generate-hashes --extra ros --extra exports --group build pyproject.toml -c requirements/dev.txt -o requirements/ros.txt
	$(COMPILE) --generate-hashes --extra exports --group build pyproject.toml -c requirements/ros.txt -o requirements/exports.txt
	$(COMPILE) requirements/train.in -c requirements/dev.txt -o requirements/train.txt
	printf 'torch==2.13.0\n' >> requirements/train.txt

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache build dist mutants
	find grasp drivers detector scenarios studies tests -name __pycache__ -type d -prune -exec rm -rf {} +
