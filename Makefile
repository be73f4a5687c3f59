# make run        install what a flight needs, fly the shipped mission in the simulator, show the map
# make test       the tests of every day: all but those of tests/slow.txt
# make test-unit  the quick ones alone: no socket, no simulator, no whole command
# make test-all   every test
# make test-real  flights of real autopilots in their own simulations: ARDUCOPTER=path PX4=path
# make reliability  campaigns for SEED=1 FLIGHTS=300, and docs/reliability.md with what they gave
# make check      ruff, mypy --strict, import-linter, prose, the documentation without a broken link
# make docs       the documentation as a site: site/index.html
# make wheel      dist/uavmap-*.whl, for `uv tool install` and `pipx install` without the source
# make setup      .venv with everything; .venv/bin/uavmap is the command
# make lock       resolve the requirements files, and the wheel's bill of materials, anew (needs uv)

PYTHON ?= python3
BIN := .venv/bin
# the generator of the site speaks of its own future otherwise
SITE = NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
# two more than there are cores: tests on sockets wait for a simulator most of their time
WORKERS ?= $(shell expr $$(nproc 2>/dev/null || echo 2) + 2)
# a flight waits for the disk at each of its events; memory is quicker, where there is a lot of it
SCRATCH := $(shell df -Pm /dev/shm 2>/dev/null | awk 'NR == 2 && $$4 > 2000 && $$NF == "/dev/shm" {print $$NF}')
PIP = $(BIN)/python -m pip install --disable-pip-version-check --no-compile --no-deps
# in the order of tests/conftest.py, which keeps all cores busy: threads of sums would only spin
PYTEST = $(if $(SCRATCH),TMPDIR=$${TMPDIR:-$(SCRATCH)} )OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 \
	$(BIN)/pytest -q -n $(WORKERS) --dist loadfile --no-loadscope-reorder

# what Python, numba and pytest compile is kept: each process would compile it anew
unexport PYTHONDONTWRITEBYTECODE

# two things at once: types are checked while kernels are compiled, and tests begin after both
ifeq (,$(filter clean,$(MAKECMDGOALS)))
MAKEFLAGS += -j2
endif
ifneq (,$(filter check,$(MAKECMDGOALS)))
test test-all: check
endif

.PHONY: run test test-unit test-all test-real reliability check docs wheel setup lock clean

run: .venv/ready
	$(BIN)/uavmap fly runway --sim

# all tests in one run, where all are asked for: those that wait leave the cores to those that compute
ifneq (,$(filter test-all,$(MAKECMDGOALS)))
test: test-all
else
test: .venv/kernels
	$(PYTEST) -m "not slow"
endif

test-all: .venv/kernels
	$(PYTEST)

test-unit: .venv/kernels
	$(PYTEST) -m "not slow and not system" tests/unit

# one after another: each flight has the whole computer. What they gave stands in a table afterwards
test-real: .venv/kernels
	UAVMAP_ARDUCOPTER="$(ARDUCOPTER)" UAVMAP_PX4="$(PX4)" $(BIN)/pytest -q tests/real; \
		code=$$?; $(BIN)/python -m tests.real.figures && exit $$code

# a flight of the whole program takes ten times as long, one of a fleet thirty times
SEED ?= 1
FLIGHTS ?= 300
reliability: .venv/kernels
	for flights in "campaign --workers 2 --flights $(FLIGHTS)" \
		"prop.missions.fleet_machine --runs $(FLIGHTS)" \
		"campaign --workers 2 --world sitl --flights $$((($(FLIGHTS) + 9) / 10))" \
		"campaign --workers 2 --world fleet --flights $$((($(FLIGHTS) + 29) / 30))"; do \
		$(BIN)/python -m tests.$$flights --record --seed $(SEED) || failed=1; done; \
		$(BIN)/python -m tests.reliability && exit $${failed:-0}

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m tests.prose
	$(BIN)/python -m tests.prose_code
	$(BIN)/python -m tests.prose_names
	$(SITE) --quiet

docs: setup
	$(SITE)

wheel: setup
	$(BIN)/python -m pip wheel --disable-pip-version-check --quiet --no-deps --wheel-dir dist .

setup: .venv/ready-dev

.venv/ready: requirements.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("uavmap needs Python 3.11 or newer; set PYTHON=...")'
	@echo "Installing uavmap into .venv: about 35 packages, 170 MB to download. This takes a minute or two."
	$(PYTHON) -m venv .venv
	-$(PIP) --quiet 'pip>=25' # the one of Python 3.11 takes more than twice as long
	$(PIP) --require-hashes -r requirements.txt
	$(PIP) --quiet --no-build-isolation -e .
	touch $@

.venv/ready-dev: .venv/ready requirements-dev.txt requirements-clients.txt
	@echo "Installing the tools and all extras into .venv: about 170 packages, 700 MB to download. This takes minutes."
	$(PIP) --require-hashes -r requirements-dev.txt -r requirements-clients.txt
	touch $@

# Kernels and tests are compiled once, before the workers of the tests would each do so.
# What is wrong with a test is said when the tests are run.
.venv/kernels: .venv/ready-dev $(wildcard missions/planning/kernels/*.py)
	@echo "Compiling the planner, once: half a minute."
	$(BIN)/python -c "from missions.planning.sweep.memo import warm_up; warm_up()" & \
	$(BIN)/uavmap simulate --generate eden --cells 30 --robots 3 --strategy rdfs,horizon \
		--json >/dev/null && { $(BIN)/pytest --collect-only -qq >/dev/null || true; } && wait $$!
	touch $@

lock:
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--extra dev --group build pyproject.toml -o requirements-dev.txt
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--group build -c requirements-dev.txt pyproject.toml -o requirements.txt
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--no-deps --group clients -o requirements-clients.txt
	uv pip compile --universal --python-version 3.11 --no-annotate --no-header --quiet \
		-c requirements.txt pyproject.toml | $(PYTHON) packaging/sbom.py > packaging/uavmap.cdx.json

# results are nobody's to delete but their owner's
clean:
	rm -rf .venv
