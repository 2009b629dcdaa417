# `make demo` and `make test` set up a virtual environment on first use; nothing else is needed
# but Python >= 3.11. Versions are those of constraints.txt.

PYTHON  ?= python3
VENV    ?= .venv
OUT     ?= demo-output
# One more than two cores: the worker of the browser tests waits most of the time.
WORKERS ?= 3
UPGRADE ?=

BIN     := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt
STAMPS  := $(VENV)/.installed
INPUTS  := pyproject.toml constraints.txt
SCRIPTS := src/eclsim/app/web tests/app/scripts

.DEFAULT_GOAL := help
.PHONY: help setup demo test quick lint format types docs lock clean

help:  ## list the targets
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10

# --- set-up: one stamp file for each group of dependencies --------------------------------------

$(STAMPS)/venv:
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(None if v >= (3, 11) else \
	  f"eclsim needs Python 3.11 or newer, $(PYTHON) is {v[0]}.{v[1]}: try make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	@mkdir -p $(STAMPS) && touch $@

$(STAMPS)/core: $(STAMPS)/venv $(INPUTS)
	@echo "Installing eclsim into $(VENV) (about 1.1 GB; once) ..."
	$(INSTALL) --editable .
	@touch $@

$(STAMPS)/dev: $(STAMPS)/core
	$(INSTALL) --editable '.[dev]'
	@touch $@

$(STAMPS)/docs: $(STAMPS)/core
	$(INSTALL) --editable '.[docs]'
	@touch $@

setup: $(STAMPS)/dev $(STAMPS)/docs  ## install everything a developer needs into .venv

# --- what it is for -----------------------------------------------------------------------------

demo: $(STAMPS)/core  ## the paper's ECMO + CRRT patient and the nine CRRT schemes, into demo-output/
	$(BIN)/eclsim demo --out $(OUT)
	$(BIN)/eclsim crrt-study $(OUT)/s4_crrt_g_3425.toml --volume-policy both --out $(OUT)/crrt-study --force

# --- checks -------------------------------------------------------------------------------------

# Without bytecode on disk every worker, and every command in a test, compiles the same sources again.
test quick: export PYTHONDONTWRITEBYTECODE :=

test: $(STAMPS)/dev  ## run all tests
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadgroup --no-loadscope-reorder

quick: $(STAMPS)/dev  ## run the tests without the slow ones
	$(BIN)/python -m pytest -n $(WORKERS) --dist loadgroup --no-loadscope-reorder -m 'not slow' \
		--durations 10 --durations-min 1

lint: $(STAMPS)/dev  ## check style and formatting
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/oxlint $(SCRIPTS)
	$(BIN)/oxfmt --check $(SCRIPTS)

format: $(STAMPS)/dev  ## apply the formatting
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/oxlint --fix $(SCRIPTS)
	$(BIN)/oxfmt $(SCRIPTS)

types: $(STAMPS)/dev  ## check types
	$(BIN)/pyright --pythonpath $(BIN)/python

docs: $(STAMPS)/docs  ## build the documentation into site/, failing on any warning
	$(BIN)/mkdocs build --strict

# --- upkeep -------------------------------------------------------------------------------------

lock: $(STAMPS)/venv  ## write uv.lock and constraints.txt from pyproject.toml (make lock UPGRADE=--upgrade: newest)
	$(INSTALL) uv
	$(BIN)/uv lock --python $(BIN)/python $(UPGRADE)
	$(BIN)/uv export --quiet --frozen --all-extras --no-hashes --no-emit-project --no-annotate \
	  --no-header --output-file constraints.txt

clean:  ## remove the environment and everything built
	rm -rf .venv .venv-ci site build dist demo-output .pytest_cache .ruff_cache .hypothesis .benchmarks
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
