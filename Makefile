# Two commands for users: `make demo` and `make test`. Both set everything up themselves.
# PYTHON chooses the interpreter that .venv is made from: make setup PYTHON=python3.12

PYTHON ?= python3
BIN := .venv/bin
BENCHMARKS := cli_startup physics_step current_sampling sensor_cost suite_step vector_env factory_speed window_reading layer_speed render_speed

.NOTPARALLEL:
.PHONY: help setup demo test test-docs test-release quick processors lint check mutants bench gallery docs lock clean

.DEFAULT_GOAL := setup

help:                     ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-13s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

setup: .venv/.installed .venv-s3/.installed .venv-hub/.installed ## virtual environment with the pinned versions, GL libraries
	@scripts/gl.sh
	@scripts/browser.sh
	@test -e .venv/.compiled || $(BIN)/twin compile
	@touch .venv/.compiled

.venv/.installed: pyproject.toml $(wildcard plugins/*/pyproject.toml) constraints.txt scripts/venv.sh
	@scripts/venv.sh "$(PYTHON)"

.venv-s3/.installed: scripts/s3_server.sh | .venv/.installed
	@scripts/s3_server.sh .venv/bin/python

.venv-hub/.installed: scripts/hub_readers.sh | .venv/.installed
	@scripts/hub_readers.sh .venv/bin/python

demo: setup               ## the main job, into demo/ (overwritten)
	@scripts/demo.sh

test: setup               ## the tests of the code; ARGS="-k name" chooses tests
	@$(BIN)/python -m pytest --part=code $(ARGS)

test-docs: setup          ## the tests of pages, tutorials and examples
	@$(BIN)/python -m pytest --part=docs tests $(ARGS)

test-release: setup       ## the tests of wheels, campaigns, browsers, clusters and real logs
	@$(BIN)/python -m pytest --part=release tests $(ARGS)

quick: setup              ## the fast files of the tests, a minute; ARGS as of `make test`
	@$(BIN)/python -m pytest --quick $(ARGS)

processors: setup         ## the tests as three x86-64 processors run them; ARGS as of `make test`
	@scripts/processors.sh $(ARGS)

lint: setup               ## style and types
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy

check: lint test test-docs test-release ## all that must hold before a commit

mutants: setup            ## change the code by chance; the tests must notice 80 % (hours)
	@$(BIN)/python scripts/mutate.py $(ARGS)

bench: setup              ## measured costs, printed beside their yardsticks
	@for benchmark in $(BENCHMARKS); do $(BIN)/python -m benchmarks.$$benchmark || exit 1; done

gallery: setup            ## the pictures of the gallery, tutorials and examples, from the code beside them
	@$(BIN)/python scripts/tutorials.py --gallery
	@$(BIN)/python scripts/tutorials.py

docs: setup               ## the documentation as a site: site/index.html; warnings are errors
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

lock:                     ## constraints.txt again, from the newest versions that pyproject.toml allows
	@scripts/lock.sh "$(PYTHON)"

clean:                    ## the environment and the caches; data/, runs/ and demo/ stay
	rm -rf .venv .venv-s3 .venv-hub .venv-lerobot build dist site .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
