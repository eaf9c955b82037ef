# Everything a contributor runs, and everything CI runs. Needs git, make and Python 3.11 or newer; the rest is brought along.
#   PYTHON=...   the Python to build .venv with          NO_UV=1   use venv and pip even where uv can be had
#   ARGS="..."   further arguments of demo, test, bench  JOBS=3    test processes: many wait, so one more than cores

PYTHON ?= python3
JOBS ?= $(shell echo $$(($$(nproc 2>/dev/null || echo 2) + 1)))
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.ready$(if $(NO_UV),-without-uv)

# Shells of robotics and Python tools set these; they would let foreign packages into .venv or point uv elsewhere.
unexport PYTHONPATH PYTHONHOME VIRTUAL_ENV CONDA_PREFIX UV_PROJECT_ENVIRONMENT UV_PYTHON
# Images of containers often set this; each of the processes that the tests start would then compile all that it imports.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help setup extra demo test soak compiled plain fresh check-compiled check check-format check-lint check-types check-imports check-lock check-wheels \
	check-docs check-install check-mf4 \
	check-socketcan bench ablation alarms matrix pair-matrix identification paper pictures rhino robots fuzz docs notice format lock clean

help: ## List the targets
	@echo 'make TARGET [ARGS="..."] [PYTHON=python3.12] [NO_UV=1] [JOBS=2]'
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: fresh ## Run the robot, the controller and the dashboard (ARGS="--law mras --seconds 10")
	@$(BIN)/canarm demo $(ARGS)

test: fresh ## Run the tests, but for the long ones (ARGS="-k encoder")
	$(BIN)/python -m pytest -n $(JOBS) -m "not slow" $(ARGS)

soak: fresh ## Run the long tests: 10^6 cycles, 10^6 frames, the whole matrix, processes on the wall clock
	$(BIN)/python -m pytest -n $(JOBS) -m slow $(ARGS)

compiled: setup ## Compile what a cycle runs through, beside its source; takes minutes, and a C compiler
	$(BIN)/python scripts/compiled.py build

plain: setup ## Take that back: the sources run
	$(BIN)/python scripts/compiled.py plain

fresh: setup
	@$(BIN)/python scripts/compiled.py fresh

# Not part of check: it compiles for minutes. .ci/run runs both.
check-compiled: setup ## Compile; are the frames of runs the same to the byte, and do the tests pass? The sources run again afterwards
	$(BIN)/python scripts/check_compiled.py --jobs $(JOBS) $(ARGS)

check: check-format check-lint check-types check-imports check-lock check-docs test check-wheels check-install check-mf4 ## Run what CI runs, but for soak and check-socketcan

check-format: setup ## Formatting
	$(BIN)/python -m ruff format --check .

check-lint: setup ## Lint rules
	$(BIN)/python -m ruff check .

check-types: setup ## Types of all packages
	$(BIN)/python -m mypy

check-imports: setup ## Which package may import which
	$(BIN)/lint-imports

check-lock: setup ## Does uv.lock fit the pyproject.toml files, and name the public index only?
	$(BIN)/python scripts/locked.py check
	scripts/uv_lock.sh --check

check-docs: setup ## Build the documentation; a link that leads nowhere fails
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict --quiet
	$(BIN)/python scripts/notice.py --check

check-install: setup ## Install as the README says, in an empty environment of every Python from 3.11 to 3.14 that is there
	$(BIN)/python scripts/try_install.py

check-mf4: setup ## Tests of records as MF4, with a library that is too slow to be among the development tools
	scripts/with_mf4.sh $(BIN)/python -m pytest tests/canarm/test_recording_formats.py

check-wheels: setup ## Build the wheels, install them alone, run them
	$(BIN)/python scripts/smoke_wheels.py

# Not part of check: where the kernel has no SocketCAN it takes minutes, root and apt. .ci/run runs both.
# The import compiles what an emulated machine would compile 25 times slower, and may not write.
# Of the conformance suite only what goes over SocketCAN; its 10^6 random frames, which need no bus, stay outside. On the
# wall clock that is what python-canopen documents: the rest asks the same cards the same, an emulated second at a time.
check-socketcan: setup ## Test emulator, controller and conformance over SocketCAN (in qemu where the kernel has none)
	$(BIN)/python -c 'import can.interfaces.socketcan, canarm.commands.controller, canarm.commands.emulator, canarm.commands.monitor, canarm.rig, \
		canopen, pytest'
	VCAN_LIMIT=$(or $(VCAN_LIMIT),2400) scripts/with_vcan.sh 'CANARM_SOCKETCAN=vcan0,vcan1 PATIENCE=10 \
		$(BIN)/python -m pytest -p no:cacheprovider -o timeout=1200 -k "test_socketcan or socketcan-sync or (documented and socketcan-wall)" \
		tests/canarm/test_socketcan.py tests/conformance $(ARGS)'

bench: setup ## Run the benchmarks (ARGS="cycle --against FILE")
	$(BIN)/python benchmarks/run.py $(ARGS)

robots: setup ## Write docs/robots.md again: every law on arms of 1 to 7 joints; takes minutes (ARGS="--jobs 4")
	$(BIN)/python scripts/robots.py $(ARGS)

ablation: setup ## Write docs/ablation.md anew: what each term of the laws is worth; takes minutes (ARGS="--jobs 4")
	$(BIN)/python scripts/ablation.py $(ARGS)

paper: setup ## Write docs/papers.md anew, and its page: what the first paper shows, measured on this bench; takes a minute
	$(BIN)/python scripts/paper.py $(ARGS)
	@$(MAKE) --no-print-directory check-docs
	@echo build/site/papers.html

pictures: setup ## Draw the pictures of README and docs anew, from runs with a fault
	$(BIN)/python scripts/dashboard_picture.py
	$(BIN)/python scripts/run_pictures.py

identification: setup ## Identify 100 drawn robots and count how often the intervals hold; takes minutes (ARGS="--cases 20")
	$(BIN)/python scripts/identification.py $(ARGS)

rhino: setup ## Write docs/rhino.md anew: two robots carry one object, the paper's result side by side; takes seconds
	$(BIN)/python scripts/rhino.py $(ARGS)

alarms: setup ## Count false alarms of 3000 robots drawn from the box; takes an hour (ARGS="--draws 300 --cells")
	$(BIN)/python scripts/alarms.py $(ARGS)

matrix: setup ## Run the fault matrix of konkuk1 against its golden copy; takes minutes (ARGS=--update-golden)
	$(BIN)/python scripts/fault_matrix.py $(ARGS)

pair-matrix: setup ## Run a share of rhino-pair's fault matrix against its golden copy; takes minutes (ARGS=--update-golden)
	$(BIN)/python scripts/pair_matrix.py $(ARGS)

# atheris is 35 MB, and there is none for every system: it is only brought along for this.
fuzz: setup ## Fuzz every door, guided by coverage: 10^7 inputs, an hour (ARGS="--inputs 100000 conditions")
	@$(BIN)/python -c 'import atheris' 2>/dev/null || if [ -e $(VENV)/uv.path ]; \
		then "$$(cat $(VENV)/uv.path)" pip install --quiet --python $(BIN)/python 'atheris>=3'; \
		else $(BIN)/python -m pip install --quiet 'atheris>=3'; fi
	$(BIN)/python scripts/fuzz.py $(ARGS)

docs: check-docs ## Build the documentation as a searchable site
	@echo build/site/index.html

notice: setup ## Write NOTICE: the licences of what an installed canarm brings along
	$(BIN)/python scripts/notice.py

format: setup ## Format the code and mend what lint can mend
	$(BIN)/python -m ruff check --fix --exit-zero --quiet .
	$(BIN)/python -m ruff format .

lock: setup ## Bring uv.lock up to date with the pyproject.toml files (ARGS=--upgrade)
	scripts/uv_lock.sh $(ARGS)

setup: $(STAMP) ## Make .venv; done again when a pyproject.toml or uv.lock changes

extra: setup ## Bring libraries for some outputs into .venv, as pip install 'canarm[mf4]' does elsewhere (EXTRA=mf4)
	@$(BIN)/python scripts/extra.py $(EXTRA)

clean: ## Remove .venv, caches and build results (not runs/)
	find protocol emulator controller \( -name "*.so" -o -name "*.pyd" \) -delete
	rm -rf $(VENV) .cache .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# The stamp names the checkout it was made for: a moved checkout, or a Python that went away, needs a new .venv.
ifneq ($(shell head -n 1 $(STAMP) 2>/dev/null && $(BIN)/python -c 'print("works")' 2>/dev/null),$(CURDIR) works)
$(STAMP): always
endif
.PHONY: always
always:

$(STAMP): pyproject.toml $(wildcard */pyproject.toml uv.lock) scripts/setup.sh
	@PYTHON='$(PYTHON)' NO_UV='$(NO_UV)' scripts/setup.sh
