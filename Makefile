# Everything runs in .venv, made on first use. Nothing of it leaves this machine.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
# Tests run side by side, each on a ROS domain of its own. Those over DDS wait most of the time, so that there are more
# workers than cores; a file stays on one of them, with what it compiled and simulated, in the order of
# test/conftest.py. The times are kept for `python tools/slowest_tests.py`.
WORKERS ?= 4
# Compiled before them, once: each worker would else compile for itself whatever it finds first, two minutes of a core.
WARM = $(BIN)/python -m stickslip_ros.cli.main warm-up >/dev/null
# Each would also rewrite the assertions of all tests, ten seconds of a core; one does, and keeps them for the others.
REWRITTEN = $(BIN)/python -m pytest --collect-only --quiet $(TESTS) >/dev/null
SIDE_BY_SIDE = -n $(WORKERS) --dist loadfile --no-loadscope-reorder --junitxml=.test_times.xml

export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST
# Some hundred processes of the tests would each translate the sources to bytecode anew where a shell forbids to keep it.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo test tests nightly quick quick_tests check docs bench matrix coverage pictures linkcheck clean
demo: $(STAMP)
	$(BIN)/stickslip demo $(DEMO)

# What needs one core runs beside the tests. Of the documentation no pages are written, which takes half of its time: what
# is wrong with it shows without.
test: $(STAMP)
	@sh tools/install_test_packages.sh
	@$(MAKE) --no-print-directory --jobs=3 check docs tests PAGES=dummy

tests: $(STAMP)
	-@$(WARM)
	-@$(REWRITTEN)
	$(BIN)/python -m pytest $(SIDE_BY_SIDE) $(TESTS)

# Also the seeds and cases that are marked nightly; CONTRIBUTING.md says which.
nightly: check
	@sh tools/install_test_packages.sh
	-@$(WARM)
	-@$(REWRITTEN)
	FUZZ_EXAMPLES=300 $(BIN)/python -m pytest $(SIDE_BY_SIDE) --nightly $(TESTS)

# For every save, in less than a minute: what starts no processes and is no long calculation. None of it waits.
quick: $(STAMP)
	@$(MAKE) --no-print-directory --jobs=2 check quick_tests

quick_tests: WORKERS := auto
quick_tests: $(STAMP)
	-@$(WARM)
	$(BIN)/python -m pytest $(SIDE_BY_SIDE) --quick $(TESTS)

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/interrogate --quiet stickslip_ros benchmarks

PAGES ?= html
docs: $(STAMP)
	$(BIN)/python -m sphinx -q -W --keep-going -b $(PAGES) docs docs/_build/$(PAGES)

linkcheck: $(STAMP)
	$(BIN)/python -m sphinx -q -b linkcheck docs docs/_build/linkcheck

# Needs chromium; RECORDINGS is a folder of real ones, for the pictures of docs/detection.md.
pictures: $(STAMP)
	$(BIN)/python docs/draw_pictures.py $(RECORDINGS)

# Of this process: what runs in processes of its own (nodes, commands over DDS) is not counted. Installed for this alone:
# where it is, numba loads it in every process.
coverage: $(STAMP)
	$(BIN)/python -m pip install --quiet pytest-cov
	$(BIN)/python -m pytest --cov=stickslip_ros --cov-report=term $(TESTS)

# Installation, demo and some tests on every Python that is there: make matrix [LEGS="noble kilted"]
matrix:
	@sh tools/matrix.sh $(LEGS)

bench: $(STAMP)
	$(BIN)/python -m benchmarks

# What setuptools says of folders named like the package is no news here, and looks like an error.
$(STAMP): setup.py
	@sh tools/check_machine.sh "$(PYTHON)"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip "setuptools<80" wheel
	PYTHONWARNINGS="ignore:Editable installation" $(BIN)/python -m pip install --quiet --no-build-isolation \
		--editable ".[ros,test]"
	$(BIN)/stickslip warm-up
	@touch $@

clean:
	rm -rf $(VENV) .matrix build docs/_build install log *.egg-info
