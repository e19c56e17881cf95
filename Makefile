# Each target creates the environment .venv if needed, and installs this package in it with the extras of the target.

PYTHON ?= python3
VENV ?= .venv
PY := $(VENV)/bin/python

extras_test := [test,browser,jax,nutpie]
extras_lint := [dev]
extras_docs := [docs]
extras_docs-check := [docs,browser]
extras_dist := [release]
extras_benchmark := [test,jax,benchmark]

.PHONY: help study artery test test-all test-second test-long test-lowest golden mutations lint plain docs docs-check dist benchmark clean

help:
	@echo "make study       run the simulated sheep-aorta study; write figures and netCDF files to results/"
	@echo "make artery      run the study of a measured pulmonary artery: control against hypertensive"
	@echo "make test        run the first tier of tests: each module and each public name; takes minutes"
	@echo "make test-all    run both tiers of tests; the second tier compiles models as users do"
	@echo "make test-long   run tests that take minutes each, before a release"
	@echo "make test-lowest run the first tier with the oldest versions that pyproject.toml allows"
	@echo "make golden      compare results with the numbers stored in tests/golden"
	@echo "make mutations   count how many small mistakes in the package the tests find; takes hours"
	@echo "make lint        run ruff and mypy"
	@echo "make plain       list sentences that are hard to read, and fail above 1 % of a folder"
	@echo "make docs        build the documentation in docs/_build/html"
	@echo "make docs-check  check each page of the documentation in a browser"
	@echo "make dist        build wheel and source distribution in dist/, and test the wheel"
	@echo "make benchmark   measure time and accuracy against other methods; takes 7 to 13 minutes"
	@echo "make clean       remove the files that targets write, except $(VENV) and results/"

study: $(VENV)/.ready-study
	$(PY) examples/sheep_aorta.py

artery: $(VENV)/.ready-study
	$(PY) examples/pulmonary_hypertension.py

# One process per core, with one thread each. The processes share the stored fits of tests/fits.py.
# Without "-p no:benchmark" the benchmark plugin would warn that it cannot measure time in parallel.
pytest := OMP_NUM_THREADS=1 $(PY) -m pytest -n auto --dist worksteal -p no:benchmark --durations=20

# The first tier, and the docstring examples.
test: $(VENV)/.ready-test
	$(pytest) $(PYTEST_OPTIONS) -m "not deep" --doctest-modules --ignore=tests/benchmarks tests pymc_hyperelastic

test-all: test test-second

# The second tier, compiled as users compile.
test-second: $(VENV)/.ready-test
	$(pytest) $(PYTEST_OPTIONS) -m "(deep or compiled) and not long" --compiled

# Tests that take minutes each, such as simulation-based calibration of complete models.
test-long: $(VENV)/.ready-test
	$(pytest) -m long --compiled

# The oldest versions that pyproject.toml allows, in a separate environment.
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

# Largest share of hard sentences of a folder, in per cent: docs/project/writing.md.
PLAIN_LIMIT ?= 1

plain: | $(PY)
	$(PY) tools/plain_english.py --limit $(PLAIN_LIMIT)

# Remove old pages first: the page of a renamed object would remain.
docs: $(VENV)/.ready-docs
	rm -rf docs/generated docs/drawings docs/_build/html
	$(PY) -m sphinx -W --keep-going -j 2 -b html docs docs/_build/html

# Checks the pages of the last "make docs".
docs-check: $(VENV)/.ready-docs-check
	$(PY) docs/check_site.py

# The wheel is built from the source distribution. The test installs only the wheel and its dependencies.
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

# A stamp file for each set of extras. A change of pyproject.toml installs the extras again.
$(VENV)/.ready-%: pyproject.toml | $(PY)
	@echo "Installing pymc_hyperelastic$(extras_$*) in $(VENV)"
	@$(PY) -m pip install --quiet --disable-pip-version-check --editable ".$(extras_$*)"
	@touch $@

# uv can install the oldest versions; pip cannot. uv keeps installed versions, so the environment is created again.
# Only wheels: if a version has no wheel for this Python, the oldest version with a wheel is installed.
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
