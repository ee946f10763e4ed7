# `make demo` for a first look, `make test` before every commit. Both make .venv and install there what they need.

SHELL := /bin/bash

# A python3 of 3.12 or newer, pyenv's included; say `make PYTHON=/path/to/python3.13 demo` for another.
NEW_ENOUGH := -c 'import sys; sys.exit(sys.version_info < (3, 12))'
PYTHON ?= $(shell for p in python3 python3.13 python3.12 $(wildcard $(HOME)/.pyenv/versions/3.1[23]*/bin/python3); do \
	$$p $(NEW_ENOUGH) 2>/dev/null && { echo $$p; break; }; done)
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml constraints.txt README.md LICENSE \
	$(shell find thermohyd identify data -type f ! -path '*/__pycache__/*')
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt

# For the inner loop: what reads, writes and prints, and a sample of every kind of physics and estimation;
# without the two files of these folders that take as long as all others together.
QUICK := identify/bench identify/report identify/noise identify/model/test_model_file.py identify/fitting/test_covariance.py \
	identify/fitting/test_least_squares.py identify/diagnosis/test_search.py identify/diagnosis/test_screening.py \
	identify/diagnosis/test_where.py simulator/test_against_reference.py simulator/test_dynamics_field.py \
	test_import_direction.py test_effect_names.py test_citations.py

.PHONY: help axe demo compare-pairs plan-rates test test-all quick lint typecheck pytest dist site api tutorial bench figures hidden hidden-bench hidden-dynamic hidden-logs joint-coverage law-coverage \
	recovery petab-select real-valve clean
help:
	@echo "make demo    fit one sample record, diagnose another, write demo-report/"
	@echo "make test    ruff, pyright and pytest against the installed package"
	@echo "make test-all  the same with whole diagnoses and statistics (over an hour on a slow machine)"
	@echo "make quick   half of the tests, those that compile little, in about a minute"
	@echo "make axe     axe-core from the npm registry, with which the tests look at the pages in a headless Chromium"
	@echo "make dist    wheel and sdist into dist/, each installed into an environment of its own elsewhere and tried (two minutes)"
	@echo "make site    the documentation as pages, into build/site (installs Zensical into $(VENV))"
	@echo "make api     docs/api.md again, from the docstrings"
	@echo "make tutorial  the tutorial and the how-to pages typed as they stand, with what computes for long (twenty minutes)"
	@echo "make bench   the benchmarks, each with its peer"
	@echo "make figures  the benchmarks again, into docs/figures and the pages that show them, with commit and date (PARTS=\"start-up hidden-1\": these; all: a day)"
	@echo "make hidden  76 records with a hidden effect, diagnosed and scored (SET=2: other seeds, SET=3: faint effects; half an hour)"
	@echo "make hidden-bench  80 records as a real bench makes them: noisy positions, faults of the bench (SET=2: other seeds; hours)"
	@echo "make hidden-dynamic  30 records of an actuator with hidden physics, diagnosed and scored (SET=2: other seeds; half an hour)"
	@echo "make hidden-logs  raw logs in which nothing is missing: do intervals hold the truth, is nothing named? (an hour)"
	@echo "make petab-select  what petab_select names on the records of hidden-bench, beside the diagnosis (SET=2: other seeds; hours)"
	@echo "make law-coverage   24 valves, made by either law of an edge and fitted with either: do intervals hold the truth? (20 minutes)"
	@echo "make joint-coverage  50 records with static and dynamic tests: do intervals hold the truth? (PLUG_IN=1: valve held; an hour)"
	@echo "make recovery  50 records for each effect freed by name: do intervals hold the truth? (EFFECTS=\"...\", PHI=0.6: AR(1) noise; an hour)"
	@echo "make real-valve  predict sweeps of a real valve that were left out of its fit, where ../shared/real is there"
	@echo "make clean   remove what was built (not $(VENV))"
	@echo "A Python of 3.12 or newer is looked for; make PYTHON=/path/to/python3.13 demo takes that one. It stays in $(VENV)."

demo: $(VENV)/.installed
	$(BIN)/thermohyd fit data/seed_valve --out demo-report
	$(BIN)/thermohyd diagnose data/hidden/bench_26 --out demo-report/diagnosis
	@echo "The reports are in demo-report/report.html and demo-report/diagnosis/report.html: open them in a browser."

test: lint typecheck pytest

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check
	$(BIN)/ruff format --check

# The source tree has identify/ and data/ beside thermohyd/, the installed package has them inside. Pyright reads a copy
# of the installed package, where imports mean what they mean to a user; file names are turned back for the reader.
typecheck: $(VENV)/.installed-dev
	@rm -rf build/typecheck && mkdir -p build/typecheck
	@cp -RL "$$($(BIN)/python -P -c 'import os, thermohyd; print(os.path.dirname(thermohyd.__file__))')" \
		tests $(wildcard benchmarks) pyproject.toml build/typecheck/
	@set -o pipefail; cd build/typecheck && $(abspath $(BIN))/pyright --pythonpath $(abspath $(BIN))/python \
		| sed -e 's|$(CURDIR)/build/typecheck/||' -e 's,thermohyd/\(identify\|data\)/,\1/,'

# What looks for faults of access in a page, of a fixed version; without npm the tests that need it skip and say so.
AXE := build/axe/package/axe.min.js
axe: $(AXE)
$(AXE):
	@mkdir -p build/axe
	npm pack --silent --pack-destination build/axe axe-core@4.14.1
	@tar xzf build/axe/axe-core-4.14.1.tgz -C build/axe

# What `make test` leaves to the night: whole diagnoses, statistics of many fits.
test-all: TESTS := -m "nightly or not nightly"
test-all: lint typecheck pytest

pytest: $(VENV)/.installed-dev
	-@test -s $(AXE) || ! command -v npm >/dev/null || $(MAKE) --silent axe
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder --max-worker-restart=0 $(TESTS)

quick: $(VENV)/.installed-dev
	$(BIN)/ruff check --quiet
	$(BIN)/pytest -q -n 2 --dist loadfile $(addprefix tests/,$(QUICK)) \
		--ignore tests/identify/report/test_diagnosis_page.py --ignore tests/identify/bench/test_mangled_records.py

# Each is installed where neither this tree nor its environment is seen, and reads a sample record that it brings along.
dist: $(VENV)/.installed-dev
	@rm -rf dist build/lib build/bdist.* *.egg-info
	$(BIN)/python -m build --outdir dist .
	@rm -rf build/lib build/bdist.* *.egg-info
	@set -e; for made in dist/*.whl dist/*.tar.gz; do \
		elsewhere=$$(mktemp -d); echo "== $$made"; \
		$(BIN)/python -m venv $$elsewhere/env; \
		$$elsewhere/env/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt $$made; \
		record=$$(cd $$elsewhere && env/bin/python -P -c "import thermohyd.data as d; print(d.sample_record('seed_valve'))"); \
		(cd $$elsewhere && env/bin/thermohyd --version && env/bin/thermohyd check $$record --out seen --quiet && test -s seen/check.png); \
		rm -rf $$elsewhere; done

# Strict: a link that leads nowhere ends it.
site: $(VENV)/.installed-dev
	$(INSTALL) '.[docs]'
	@rm -rf build/lib build/bdist.* *.egg-info
	$(BIN)/zensical build --strict

# The page of the public API, from the docstrings.
api: $(VENV)/.installed-dev
	$(BIN)/python tools/api_page.py

tutorial: $(VENV)/.installed-dev
	THERMOHYD_TUTORIAL=1 $(BIN)/pytest -q tests/test_documentation.py

bench: $(VENV)/.installed-dev
	@for script in $(filter-out benchmarks/hidden_% benchmarks/joint_% benchmarks/law_% benchmarks/recovery.py benchmarks/real_valve.py \
		benchmarks/hanging_load.py benchmarks/figures.py benchmarks/compare_pairs.py benchmarks/plan_rates.py benchmarks/leave_one_out% benchmarks/calibration.py \
		benchmarks/fleet_% benchmarks/mangled_records.py \
		benchmarks/search_constants.py benchmarks/nuisances.py benchmarks/petab_%,$(wildcard benchmarks/[a-z]*.py)); do \
		echo "== $$script"; $(BIN)/python $$script || exit 1; done

figures: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/figures.py $(PARTS)

# Answers and table stay in build/hidden; an interrupted run goes on where it stopped.
SET ?= 1
PROCESSES ?= 2
hidden: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/hidden_table.py --set $(SET) --processes $(PROCESSES)

hidden-bench: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/hidden_bench_table.py --set $(SET) --processes $(PROCESSES)

hidden-dynamic: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/hidden_dynamic_table.py --set $(SET)

hidden-logs: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/hidden_raw_logs.py fit
	$(BIN)/python benchmarks/hidden_raw_logs.py leakage
	$(BIN)/python benchmarks/hidden_raw_logs.py diagnose

petab-select: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/petab_select_baseline.py --set $(SET) --processes $(PROCESSES)

law-coverage: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/law_coverage.py --processes $(PROCESSES)

joint-coverage: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/joint_coverage.py --processes $(PROCESSES) $(if $(PLUG_IN),--plug-in)

recovery: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/recovery.py --processes $(PROCESSES) $(if $(EFFECTS),--effects $(EFFECTS)) $(if $(PHI),--phi $(PHI))

compare-pairs: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/compare_pairs.py --seed $(SET) --processes $(PROCESSES)

plan-rates: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/plan_rates.py --seed $(SET) --processes $(PROCESSES)

real-valve: $(VENV)/.installed-dev
	$(BIN)/python benchmarks/real_valve.py --out build/real_valve

clean:
	rm -rf build dist *.egg-info demo-report .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -not -path './$(VENV)/*' -exec rm -rf {} +

$(BIN)/python:
	@test -n "$(PYTHON)" && $(PYTHON) $(NEW_ENOUGH) || \
		{ echo "thermohyd needs Python 3.12 or newer: make PYTHON=/path/to/python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

# It may be of a time when an older Python was enough; it is not removed unasked, as it may hold what somebody added.
STILL_NEW_ENOUGH = $(BIN)/python $(NEW_ENOUGH) || { \
	echo "$(VENV) holds a Python older than the 3.12 that thermohyd needs: rm -rf $(VENV), then make again."; exit 1; }

# Old build folders would put deleted modules into the wheel, and an old package folder may be links into this tree.
$(VENV)/.installed: $(SOURCES) | $(BIN)/python
	@$(STILL_NEW_ENOUGH)
	@rm -rf build/lib build/bdist.* *.egg-info $(VENV)/lib/python3*/site-packages/thermohyd
	$(INSTALL) .
	@rm -rf build/lib build/bdist.* *.egg-info && touch $@

$(VENV)/.installed-dev: $(SOURCES) | $(BIN)/python
	@$(STILL_NEW_ENOUGH)
	@rm -rf build/lib build/bdist.* *.egg-info $(VENV)/lib/python3*/site-packages/thermohyd
	$(INSTALL) '.[dev]'
	@rm -rf build/lib build/bdist.* *.egg-info && touch $@ $(VENV)/.installed
