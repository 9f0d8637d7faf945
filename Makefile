PYTHON ?= python3
VENV   ?= .venv
BIN     = $(VENV)/bin
WORKERS ?= 2

.PHONY: demo test lint types bench bench-quick clean

# Strict editable mode is what type checkers can follow; it must be made anew when files come or go.
$(VENV)/installed: pyproject.toml constraints.txt cli schemas ingest ingest/can ingest/oxts dataset dataset/review modeling modeling/export modeling/simulation report
	test -d $(VENV) || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --config-settings editable_mode=strict --editable ".[dev,mf4,onnx]"
	touch $@

demo: $(VENV)/installed
	$(BIN)/wheelprint demo

test: $(VENV)/installed
	$(BIN)/python -m pytest --numprocesses $(WORKERS)

lint: $(VENV)/installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/installed
	$(BIN)/mypy -p wheelprint
	$(BIN)/mypy --explicit-package-bases tests benchmarks docs

# The other tools stand in an environment of their own, so that none of them is needed elsewhere.
$(VENV)-bench/installed: pyproject.toml constraints.txt benchmarks/peers.txt
	test -d $(VENV)-bench || $(PYTHON) -m venv $(VENV)-bench
	$(VENV)-bench/bin/python -m pip install --quiet --upgrade pip
	$(VENV)-bench/bin/python -m pip install --quiet --constraint constraints.txt --requirement benchmarks/peers.txt --editable ".[mf4,onnx]"
	touch $@

bench: $(VENV)-bench/installed
	$(VENV)-bench/bin/python -m benchmarks.run $(BENCH)

bench-quick: $(VENV)/installed
	$(BIN)/python -m benchmarks.run --quick

clean:
	rm -rf $(VENV) $(VENV)-bench build *.egg-info demo
