# Everything runs in .venv, made on first use. Nothing of it leaves this machine.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

.PHONY: demo test check bench clean
demo: $(STAMP)
	$(BIN)/stickslip demo $(DEMO)

test: check
	@sh tools/install_test_packages.sh
	$(BIN)/python -m pytest $(TESTS)

check: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(STAMP)
	$(BIN)/python -m benchmarks

$(STAMP): setup.py
	@sh tools/check_machine.sh "$(PYTHON)"
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip "setuptools<80" wheel
	$(BIN)/python -m pip install --quiet --no-build-isolation --editable ".[ros,test]"
	@touch $@

clean:
	rm -rf $(VENV) build install log *.egg-info
