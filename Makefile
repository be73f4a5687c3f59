# make run    set up, fly the shipped runway mission in the simulator, show the results
# make test   set up, run every test
# make check  set up, ruff, mypy --strict, import-linter, the documentation without a broken link
# make docs   set up, the documentation as a site: site/index.html
# make setup  only .venv, whose bin/uavmap is the command
# make kernels  compile what numba compiles, and the tests, which else the first flight and each
#               worker of the tests do
# make lock   resolve the two requirements files anew (needs uv)

PYTHON ?= python3
BIN := .venv/bin
# the generator of the site speaks of its own future otherwise
SITE = NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
# one more than there are cores: tests on sockets wait for a simulator most of their time
WORKERS ?= $(shell expr $$(nproc 2>/dev/null || echo 2) + 1)
# a flight waits for the disk at each of its events; memory is quicker, where there is a lot of it
SCRATCH := $(shell df -Pm /dev/shm 2>/dev/null | awk 'NR == 2 && $$4 > 2000 && $$NF == "/dev/shm" {print $$NF}')

# what Python and pytest have compiled is kept: each process, and each worker of the tests, compiles
# all of it anew otherwise, which takes it longer than to import it
unexport PYTHONDONTWRITEBYTECODE

# two things at once: types are checked while kernels are compiled, and tests begin after both
ifeq (,$(filter clean,$(MAKECMDGOALS)))
MAKEFLAGS += -j2
endif
ifneq (,$(filter check,$(MAKECMDGOALS)))
test: check
endif

.PHONY: run test check docs setup kernels lock clean

run: setup
	$(BIN)/uavmap fly runway --sim

# in the order of tests/conftest.py, which keeps all cores busy
test: kernels
	$(if $(SCRATCH),TMPDIR=$${TMPDIR:-$(SCRATCH)} )$(BIN)/pytest -q -n $(WORKERS) --dist loadfile --no-loadscope-reorder

check: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(SITE) --quiet

docs: setup
	$(SITE)

setup: .venv/ready

# what is wrong with a test is said when the tests are run
kernels: setup
	$(BIN)/uavmap simulate --generate eden --cells 30 --robots 3 --strategy swath,survey --offline \
		--json >/dev/null & \
	$(BIN)/uavmap simulate --generate eden --cells 30 --robots 3 --strategy rdfs,horizon \
		--json >/dev/null && { $(BIN)/pytest --collect-only -qq >/dev/null || true; } && wait $$!

# pip compiles one file after the other, and all of them: the packages' own tests, and forty dialects
# of MAVLink, each as large as a small library. They are compiled if ever they are imported.
NOT_COMPILED := '/tests?/|/dialects/v[12]0/(?!ardupilotmega|common|minimal|standard)'

.venv/ready: requirements.txt requirements-clients.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("uavmap needs Python 3.11 or newer; set PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --no-deps \
		--require-hashes -r requirements.txt -r requirements-clients.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(BIN)/python -m compileall -qq -j 0 -x $(NOT_COMPILED) .venv/lib || true
	touch $@

lock:
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--extra dev pyproject.toml -o requirements.txt
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-annotate --no-header \
		--no-deps --group clients -o requirements-clients.txt

# results are nobody's to delete but their owner's
clean:
	rm -rf .venv
