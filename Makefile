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

.PHONY: help study artery test test-deep test-long test-lowest lint docs docs-check dist benchmark clean

help:
	@echo "make study       the simulated sheep-aorta study: a table, figures and netCDF files in results/"
	@echo "make artery      the same for a measured pulmonary artery, control against hypertensive"
	@echo "make test        the tests of every module and every public name, on two processes, 10 to 15 minutes"
	@echo "make test-deep   the tests that take longer: slow samplers, other compilers, all digits"
	@echo "make test-long   those that take minutes each: calibration of whole models; run before a release"
	@echo "make test-lowest what make test runs, on the oldest versions that pyproject.toml allows"
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

# Two processes with one thread each. Tests of one file share its fitted results: a process takes them in a row, and
# takes some of the other's when it has none left.
# The plugin of the benchmarks, where it is installed, may warn that it cannot time two processes at once.
pytest := OMP_NUM_THREADS=1 $(PY) -m pytest -n 2 --dist worksteal -p no:benchmark

# The first tier, with the examples of the docstrings. A test of it that takes longer than this many seconds fails.
LONGEST_TEST ?= 10
test: $(VENV)/.ready-test
	$(pytest) -m "not deep" --longest-test $(LONGEST_TEST) --doctest-modules --ignore=tests/benchmarks tests pymc_hyperelastic

# The second tier, and what the first one runs in Python once more as users have it.
test-deep: $(VENV)/.ready-test
	$(pytest) -m "(deep or compiled) and not long" --compiled
	$(pytest) --compiled --doctest-modules pymc_hyperelastic

# What takes minutes each: simulation-based calibration and whole models by Hamiltonian Monte Carlo.
test-long: $(VENV)/.ready-test
	$(pytest) -m long --compiled

# The oldest versions that pyproject.toml allows, in an environment within the environment. They interpret three times
# as slowly, some figures ten times: no test is too long here.
test-lowest: $(VENV)/lowest/.ready-test
	@$(MAKE) --no-print-directory VENV=$(VENV)/lowest LONGEST_TEST=0 test

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
	print(ph.__version__, ph.inflation_pressure(ph.Ogden(), 8.0, inner_radius=7.0, outer_radius=9.0, mu=30.0, alpha=7.0).eval())"
	rm -rf dist/empty

benchmark: $(VENV)/.ready-benchmark
	mkdir -p results
	OMP_NUM_THREADS=1 $(PY) -m pytest tests/benchmarks -o python_files='bench_*.py' \
	--benchmark-json=results/benchmark.json
	$(PY) tests/benchmarks/report.py results/benchmark.json

clean:
	rm -rf docs/_build docs/gallery docs/generated docs/drawings docs/sg_execution_times.rst docs/strain_energies.md examples/report.html dist .pytensor .ci/venv .ci/*.log
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
