# Everything that is done with this checkout. `make help` lists it.
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
MAKEFLAGS += --no-print-directory

PYTHON ?= python3.11
BIN := .venv/bin
UV := VIRTUAL_ENV=$(CURDIR)/.venv $(BIN)/uv
SERVICES := planner scheduler robot-agent vision sim
RUN ?= run
MINUTES ?= 90
MEMBERS := schemas bus cli $(SERVICES:%=services/%)

.PHONY: help install demo up down test test-long lint format schemas bench evaluation requirements train-planner train-vision clean

help: ## list these targets
	@sed -nE 's/^([a-z-]+):[^#]*## (.*)/  \1|\2/p' $(MAKEFILE_LIST) | column -t -s '|'

# Two stamps, so that a second `make install` does nothing: one for uv, one for everything else.
install: .venv/.installed ## install everything into .venv (needs Python 3.11, git and make)

.venv/.bootstrapped: requirements/bootstrap.txt
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) is missing: install Python 3.11, or say make PYTHON=/its/path" >&2; exit 1; }
	@echo "[1/3] A virtual environment in .venv, and uv in it"
	@$(PYTHON) -m venv .venv || { echo "$(PYTHON) cannot make virtual environments (on Debian: install python3.11-venv)" >&2; exit 1; }
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r $<
	@touch $@

.venv/.installed: .venv/.bootstrapped requirements/development.txt requirements/build.txt $(MEMBERS:%=%/pyproject.toml)
	@echo "[2/3] Other people's packages, pinned and hashed (some GB the first time, mostly torch)"
	@$(UV) pip install --require-hashes -r requirements/build.txt -r requirements/development.txt
	@echo "[3/3] Our own packages, editable"
	@$(UV) pip install --no-deps --no-build-isolation $(MEMBERS:%=--editable %)
	@touch $@

demo: install ## start the whole site, run one real instruction with live progress, show what came of it, stop
	@$(BIN)/muster demo

up: install ## start the site and leave it running
	@$(BIN)/muster up

down: ## stop the site
	@if [ -x $(BIN)/muster ]; then $(BIN)/muster down; else echo "Nothing is installed, so nothing runs."; fi

test: lint ## run all checks and tests (pytest's own options in ARGS)
	@$(BIN)/python -m pytest $(ARGS)

# About an hour on two quiet cores: 5,000 seeds (15 min), every place of the crash sweep and pairs (45 min).
test-long: install ## run the long forms of the proofs as well: thousands of seeds, a kill at every place (about an hour)
	@$(BIN)/python -m pytest -m long $(ARGS)

lint: install ## check form, types, and that generated files are what they should be
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/python -m muster_schemas.export . --check
	@$(BIN)/pyright

format: install ## put the code into form
	@$(BIN)/ruff format .
	@$(BIN)/ruff check --fix .

schemas: install ## write what is generated: docs/channels.md, schemas/json, router/zenohd.json5
	@$(BIN)/python -m muster_schemas.export .
	@$(BIN)/python -m muster_bus.zenohd router/zenohd.json5

bench: install ## measure, print a table, write benchmarks/results.json
	@$(BIN)/python -m benchmarks

DATASET ?= services/planner/training/development.jsonl

evaluation: install ## measure the embedded planner's plans, write docs/evaluation/ (some minutes)
	@$(BIN)/muster evaluate $(DATASET) --out docs/evaluation/$(basename $(notdir $(DATASET)))

# The lock holds download addresses of one registry, so it stays out of git; what is exported from it has none.
LOCKED := env -u UV_FIND_LINKS -u UV_INDEX -u UV_INDEX_URL -u VIRTUAL_ENV $(BIN)/uv
EXPORT := $(LOCKED) export --frozen --quiet --format requirements-txt --no-emit-workspace --no-header
OVERRIDDEN := --prune llm --prune llama-cpp-python --prune sentence-transformers

requirements: .venv/.bootstrapped ## pin requirements/*.txt anew (UPGRADE=1: to the newest versions allowed)
	@$(LOCKED) lock $(if $(UPGRADE),--upgrade)
	@for name in $(SERVICES) cli; do $(EXPORT) --package muster-$$name $(OVERRIDDEN) > requirements/$$name.txt; done
	@$(EXPORT) --all-packages --all-extras --all-groups > requirements/development.txt
	@for name in build bootstrap; do $(EXPORT) --only-group $$name > requirements/$$name.txt; done
	@wc -l requirements/*.txt

train-planner: install ## train the embedded planner's model, or go on (RUN=name, MINUTES=90)
	@cd services/planner && ../../$(BIN)/python -m training.train --run $(RUN) --minutes $(MINUTES)
	@cd services/planner && ../../$(BIN)/python -m training.export --run $(RUN) --to src/muster_planner/models/planner
	@cd services/planner && ../../$(BIN)/python -m training.evaluate training/development.jsonl

train-vision: install ## train the detector's model anew
	@cd services/vision && ../../$(BIN)/python -m training

clean: down ## remove what was built, installed and recorded
	rm -rf .venv .muster .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
