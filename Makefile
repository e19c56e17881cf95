# Every target makes what it needs: an environment in .venv and, in it, this package with the extras of the target.

PYTHON ?= python3
VENV ?= .venv
PY := $(VENV)/bin/python

extras_test := [test,browser,jax,nutpie]
extras_lint := [dev]
extras_docs := [docs]
extras_docs-check := [docs,browser]
extras_dist := [release]
extras_benchmark := [test,jax,benchmark]

.PHONY: help study artery test test-all test-second test-long test-lowest golden mutations lint docs docs-check dist benchmark clean

help:
	@echo "make study       the simulated sheep-aorta study: a table, figures and netCDF files in results/"
	@echo "make artery      the same for a measured pulmonary artery, control against hypertensive"
	@echo "make test        the first tier of tests: every module and every public name, in minutes"
	@echo "make test-all    both tiers of tests; the second compiles models as users do and tests them in full"
	@echo "make test-long   tests that take minutes each: calibration of whole models; run before a release"
	@echo "make test-lowest the first tier on the oldest versions that pyproject.toml allows"
	@echo "make golden      compare the package with the numbers stored in tests/golden"
	@echo "make mutations   measure how many small mistakes in the package the tests find; takes hours"
	@echo "make lint        ruff and mypy"
	@echo "make docs        the documentation, in docs/_build/html"
	@echo "make docs-check  look at every page of it in a browser, on narrow and wide screens, light and dark"
	@echo "make dist        wheel and source distribution in dist/, tried in an empty environment"
	@echo "make benchmark   time and accuracy against other ways, about 7 minutes"
	@echo "make clean       remove what the other targets made, except $(VENV) and results/"

study: $(VENV)/.ready-study
	$(PY) examples/sheep_aorta.py

artery: $(VENV)/.ready-study
	$(PY) examples/pulmonary_hypertension.py

# One process per core, with one thread each. Processes share the stored fits of tests/fits.py.
# The benchmark plugin, where it is installed, warns that it cannot time several processes at once.
pytest := OMP_NUM_THREADS=1 $(PY) -m pytest -n auto --dist worksteal -p no:benchmark --durations=20

# The first tier, with the docstring examples.
test: $(VENV)/.ready-test
	$(pytest) $(PYTEST_OPTIONS) -m "not deep" --doctest-modules --ignore=tests/benchmarks tests pymc_hyperelastic

test-all: test test-second

# The second tier, and the docstring examples once more, compiled as users compile.
test-second: $(VENV)/.ready-test
	$(pytest) $(PYTEST_OPTIONS) -m "(deep or compiled) and not long" --compiled
	$(pytest) $(PYTEST_OPTIONS) --compiled --doctest-modules pymc_hyperelastic

# Tests that take minutes each: simulation-based calibration and Hamiltonian Monte Carlo of whole models.
test-long: $(VENV)/.ready-test
	$(pytest) -m long --compiled

# The oldest versions that pyproject.toml allows, in an environment within the environment.
test-lowest: $(VENV)/lowest/.ready-test
	@$(MAKE) --no-print-directory VENV=$(VENV)/lowest test

golden: $(VENV)/.ready-test
	OMP_NUM_THREADS=1 $(PY) tests/golden/record.py --compare

mutations: $(VENV)/.ready-test
	$(PY) tests/mutations.py run

lint: $(VENV)/.ready-lint
	$(PY) -m ruff check
	$(PY) -m ruff format --check
	$(PY) -m mypy

# All pages are written anew, so that none outlives its name.
docs: $(VENV)/.ready-docs
	rm -rf docs/generated docs/drawings docs/_build/html
	$(PY) -m sphinx -W --keep-going -j 2 -b html docs docs/_build/html

# What make docs built last.
docs-check: $(VENV)/.ready-docs-check
	$(PY) docs/check_site.py

# The wheel is built from the source distribution, and both are what people would install: nothing else is there but
# what they bring with them.
dist: $(VENV)/.ready-dist
	rm -rf dist
	$(PY) -m build --quiet
	$(PY) -m twine check --strict dist/*
	$(PYTHON) -m venv --clear dist/empty
	dist/empty/bin/python -m pip install --quiet --disable-pip-version-check dist/*.whl
	cd dist && PYTENSOR_FLAGS=mode=FAST_COMPILE empty/bin/python -W error -c "import pymc_hyperelastic as ph; \
	print(ph.__version__, ph.inflation_pressure(ph.Ogden(), 8.0, ph.Tube(7.0, 9.0), mu=30.0, alpha=7.0).eval())"
	rm -rf dist/empty

benchmark: $(VENV)/.ready-benchmark
	mkdir -p results
	OMP_NUM_THREADS=1 $(PY) -m pytest tests/benchmarks -o python_files='bench_*.py' \
	--benchmark-json=results/benchmark.json
	$(PY) tests/benchmarks/report.py results/benchmark.json

clean:
	rm -rf tests/.fits docs/_build docs/gallery docs/generated docs/drawings docs/sg_execution_times.rst docs/strain_energies.md examples/report.html dist .pytensor .ci/venv .ci/*.log
	rm -rf .pytest_cache .mypy_cache .ruff_cache
	find pymc_hyperelastic tests examples docs -name __pycache__ -prune -exec rm -rf {} +

# A stamp for each set of extras; older than pyproject.toml, it is made again.
$(VENV)/.ready-%: pyproject.toml | $(PY)
	@echo "Installing pymc_hyperelastic$(extras_$*) in $(VENV)"
	@$(PY) -m pip install --quiet --disable-pip-version-check --editable ".$(extras_$*)"
	@touch $@

# pip takes the newest versions and only uv the oldest; it keeps what is installed already, so it starts afresh.
# Wheels only: where a version has none for this Python, the oldest that has one.
$(VENV)/lowest/.ready-test: pyproject.toml | $(PY)
	@echo "Installing the oldest versions in $(VENV)/lowest"
	@$(PY) -m venv --clear $(VENV)/lowest
	@$(VENV)/lowest/bin/python -m pip install --quiet --disable-pip-version-check uv
	@$(VENV)/lowest/bin/uv pip install --quiet --python $(VENV)/lowest/bin/python \
	--resolution lowest-direct --only-binary :all: --editable ".[test]"
	@touch $@

$(PY):
	@$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 12))" || \
	{ echo "'$(PYTHON)' is not Python 3.12 or newer; name one that is: make PYTHON=/path/to/python3.13"; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); exit 1; }
