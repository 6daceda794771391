# What a new user runs: `make demo`, then `make test`. Everything lives in .venv.
PYTHON ?= python3
# LeRobot needs it since release 0.5
PYTHON312 ?= python3.12
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
STAMP := $(VENV)/.installed-dev

.PHONY: help demo test test-all test-fast test-changed journeys coverage lint docs lab lerobot bench accuracy results strangers reliability shipped clean

help:
	@echo "make demo       reproduce the paper: figures, results and a page in out/reproduce"
	@echo "make test       every behaviour, ruff, the type check and the layer check"
	@echo "make test-all   this, and then more seeds and cases of the same"
	@echo "make test-fast  the tests that finish within a minute"
	@echo "make test-changed  the fast tests that import what was changed"
	@echo "make journeys   whole ways of the docs as commands of the installed wheel, ten seeds each"
	@echo "make shipped    fits the shipped rig da-vinci-grasper anew; its logs are in DISTAL_DATA"
	@echo "make coverage   which share of each package's statements the fast tests run"
	@echo "make docs       a site with all pages and the reference of public names in out/site"
	@echo "make lab        the paper's rig in the browser, docs/lab.html, which the site and the demo show"
	@echo "make bench      accuracy and speed of stepping, filters, batches, processes; the filter on a microcontroller"
	@echo "make accuracy   rigs it was not built with; plants x scenarios x estimators x 20 seeds; fits (an hour)"
	@echo "make results    the other tables of docs/results: exports, guards, imported models, soak (hours)"
	@echo "make strangers  rigs and logs that distal was not built with"
	@echo "make reliability  20,000 hostile rigs, logs and stream inputs each (6 minutes)"
	@echo "make lerobot    copies of LeRobot datasets, read by three releases of LeRobot in environments of their own (gigabytes)"
	@echo "make clean      remove .venv, out and caches"

PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check

# what the demo needs: the package alone
$(INSTALLED): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "distal needs Python 3.11 or newer; try make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e .
	@touch $@

# what tests, checks and pages need too
$(STAMP): $(INSTALLED)
	$(PIP) -e '.[dev]'
	@touch $@

demo: $(INSTALLED)
	$(BIN)/distal reproduce --out out/reproduce

# files go to whoever is free: what tests of one file have in common is made once
PYTEST := $(BIN)/python -m pytest -n 2 --dist worksteal

# kernels that are compiled in a third of the time: what runs them as users do asks for that itself
test: lint
	DISTAL_COMPILE=quick $(PYTEST) -m "not more"

test-all: test
	$(PYTEST) -m more

test-fast: $(STAMP)
	DISTAL_COMPILE=quick $(PYTEST) -m "not slow and not more"

test-changed: $(STAMP)
	@$(BIN)/python -m tools.changed | DISTAL_COMPILE=quick xargs --no-run-if-empty $(BIN)/python -m pytest -q -m "not slow and not more"

journeys: $(STAMP)
	DISTAL_JOURNEYS=10 $(PYTEST) tests/journeys

shipped: $(STAMP)
	$(BIN)/python -m tools.shipped "$(DISTAL_DATA)"

coverage: $(STAMP)
	$(PYTEST) -m "not slow and not more" -q --cov=distal --cov-report=json:out/coverage.json
	$(BIN)/python -m tools.coverage out/coverage.json

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tools.size --check
	$(BIN)/python -m tools.untyped --check

docs: $(STAMP)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "open out/site/index.html, or with search: $(BIN)/python -m http.server -d out/site"

lab: $(STAMP)
	$(BIN)/python -m tools.lab paper-2008 --out docs/lab.html

reliability: $(STAMP)
	$(BIN)/python -m benchmarks.reliability

bench: $(STAMP)
	$(BIN)/python -m benchmarks.structures
	$(BIN)/python -m benchmarks.stepping
	$(BIN)/python -m benchmarks.speed
	$(BIN)/python -m benchmarks.diagnosis
	$(BIN)/python -m benchmarks.chains cost stick-slip energy stepping
	$(BIN)/python -m benchmarks.microcontroller

accuracy: $(STAMP)
	$(BIN)/python -m benchmarks.strangers
	$(BIN)/python -m benchmarks.accuracy
	$(BIN)/python -m benchmarks.chains accuracy
	$(BIN)/python -m benchmarks.fitting
	$(BIN)/python -m benchmarks.hands orca
	$(BIN)/python -m benchmarks.hands aero
	$(BIN)/python -m benchmarks.hands faults --draws 24
	$(BIN)/python -m benchmarks.hands sound --draws 40
	$(BIN)/python -m benchmarks.hands_watched
	$(BIN)/python -m benchmarks.power_on_faults
	$(BIN)/python -m benchmarks.motor_faults
	$(BIN)/python -m benchmarks.servos
	$(BIN)/python -m benchmarks.out_of_reach
	$(BIN)/python -m benchmarks.newcomers --busy 8
	$(BIN)/python -m benchmarks.fit_command named
	$(BIN)/python -m benchmarks.from_logs structure
	$(BIN)/python -m benchmarks.from_logs columns --rigs 36
	$(BIN)/python -m benchmarks.from_logs rigs --rigs 20
	$(BIN)/python -m benchmarks.vendor_columns
	$(BIN)/python -m benchmarks.positions_only
	$(BIN)/python -m benchmarks.late
	$(BIN)/python -m benchmarks.learned plants
	$(BIN)/python -m benchmarks.one_map --seeds 2
	$(BIN)/python -m benchmarks.fit_command lacking --rigs 60 --candidates
	$(BIN)/python -m benchmarks.searches
	$(BIN)/python -m benchmarks.likelihood_power
	$(BIN)/python -m benchmarks.strangers.drawn --processes 2
	$(BIN)/python -m benchmarks.commands --fit
	$(BIN)/python -m benchmarks.control
	$(BIN)/python -m benchmarks.sheaths

results: $(STAMP)
	$(BIN)/python -m benchmarks.csv_readers
	$(BIN)/python -m benchmarks.door
	$(BIN)/python -m benchmarks.events
	$(BIN)/python -m benchmarks.touch
	$(BIN)/python -m benchmarks.false_touches
	$(BIN)/python -m benchmarks.exports
	$(BIN)/python -m benchmarks.guards
	$(BIN)/python -m benchmarks.ablation
	$(BIN)/python -m benchmarks.hysteresis
	$(BIN)/python -m benchmarks.imported_models
	$(BIN)/python -m benchmarks.paper_search
	$(BIN)/python -m benchmarks.mujoco_tendons
	$(BIN)/python -m benchmarks.sensitivity
	$(BIN)/python -m benchmarks.silent
	$(BIN)/python -m benchmarks.wrong_inputs
	$(BIN)/python -m benchmarks.bad_seconds
	$(BIN)/python -m benchmarks.smoothing
	$(BIN)/python -m benchmarks.soak
	$(BIN)/python -m benchmarks.odd_logs
	$(BIN)/python -m benchmarks.batch_estimator

lerobot: $(INSTALLED)
	for release in "[dataset]==0.6.1" "==0.4.4" "==0.3.3"; do \
	  case $$release in *0.6*) python=$(PYTHON312);; *) python=$(PYTHON);; esac; \
	  $$python -m venv "out/lerobot$$release" && \
	  "out/lerobot$$release/bin/pip" install --quiet -e '.[parquet]' "lerobot$$release" "numpy<2.4" pandas && \
	  "out/lerobot$$release/bin/python" -m benchmarks.lerobot_round_trip || exit 1; \
	done

strangers: $(STAMP)
	$(BIN)/python -m benchmarks.strangers
	$(BIN)/python -m benchmarks.ladder 5011

clean:
	rm -rf $(VENV) out .pytest_cache .mypy_cache .ruff_cache
