# Every command a user or a developer needs; `make` alone lists them.
# The set-up itself is tools/setup.py, which also runs where there is no make (Windows).

# make setup PYTHON=/path/to/python3.13 chooses the interpreter of the environment.
# One that merely exists is not enough: a pyenv shim may stand for a version that is not installed.
PYTHON ?= $(shell for name in python3.11 python3.13 python3; do "$$name" -c '' 2>/dev/null && command -v "$$name" && break; done)
ifeq ($(OS),Windows_NT)
VENV := .venv/Scripts/python.exe
else
VENV := .venv/bin/python
endif

.DEFAULT_GOAL := help
.PHONY: help setup demo test test-window test-blenders fuzz mutants lint format types rooms ci doctor extension clean

help: ## List these commands
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: ## Make .venv with everything needed (minutes the first time, then nothing)
	@test -n "$(PYTHON)" || { echo "make setup: Python was not found; install Python 3.11 or 3.13 (Debian: apt-get install python3 python3-venv)." >&2; exit 1; }
	@"$(PYTHON)" tools/setup.py $(if $(filter file,$(origin PYTHON)),,--python "$(PYTHON)")

demo: setup ## Fit a face from a photograph and show it in a Blender scene
	@$(VENV) -P -m facestage_blender.demo

# Each process takes one core and up to 2 GiB; make test PROCESSES=0 runs the tests in one, for a debugger.
PROCESSES ?= auto
# What a test imports is compiled once, not in each of the hundred processes that tests start.
test: export PYTHONDONTWRITEBYTECODE :=
test: setup ## Run all tests, in a process for each core
	@$(VENV) -m pytest --numprocesses $(PROCESSES) --maxprocesses 4 --dist worksteal

# Blender goes into WINDOW (1.7 GB, once), the pictures into out/window.
WINDOW ?= $(HOME)/.cache/facestage-window/trixie
test-window: extension ## Walk through the add-on in a real Blender's window, with pictures (root on Debian)
	@$(VENV) tools/set_up_window.py "$(WINDOW)"
	@FACESTAGE_WINDOW="$(WINDOW)" $(VENV) -m pytest --numprocesses 0 --exitfirst tests/window

# Each takes 1.2 GB, once, and five minutes: make test-blenders BLENDERS="4.2 5.2".
BLENDERS ?=
test-blenders: export PYTHONDONTWRITEBYTECODE :=
test-blenders: setup ## Run the add-on's tests in Blender 4.2, 4.5 and 5.2 too, without a window
	@$(VENV) tools/try_blenders.py --folder "$(HOME)/.cache/facestage-blenders" $(BLENDERS)

mutants: setup ## Say which small errors no test would see (an hour or more; docs/testing.md)
	@$(VENV) tools/mutate.py

# make fuzz INPUTS=1000000, SECONDS=3600, SEED=1, TARGET="job photo"; REPEAT=job/0/123 reads one input again.
fuzz: setup ## Read 100,000 damaged inputs; keep what is found (docs/testing.md)
	@cd tests && $(abspath $(VENV)) -m fuzz $(if $(INPUTS),--inputs $(INPUTS)) $(if $(SECONDS),--seconds $(SECONDS)) $(if $(SEED),--seed $(SEED)) $(if $(TARGET),--target $(TARGET)) $(if $(REPEAT),--repeat $(REPEAT))

lint: setup ## Check style, and the walls between the rooms
	@$(VENV) -m ruff check .
	@$(VENV) -m ruff format --check .
	@$(dir $(VENV))lint-imports --no-logo --no-cache
	@$(VENV) tools/draw_rooms.py --check

format: setup ## Rewrite the code in the project's style
	@$(VENV) -m ruff check --fix .
	@$(VENV) -m ruff format .

types: setup ## Check types
	@$(VENV) -m mypy --num-workers auto

rooms: setup ## Draw who imports whom into docs/images (docs/architecture.md)
	@$(VENV) tools/draw_rooms.py

ci: ## What continuous integration runs: set-up, style, types, tests
	@.ci/run

doctor: setup ## Say what works on this machine and how to mend what does not
	@$(VENV) -P -m facestage.doctor

extension: setup ## Build the Blender extension into dist/
	@$(VENV) tools/build_extension.py

clean: ## Remove everything that was built, the environment included
	rm -rf .venv build dist out .mypy_cache .ruff_cache .pytest_cache .hypothesis backend/*.egg-info addon/*.egg-info *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
