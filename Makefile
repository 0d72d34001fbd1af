# On a fresh machine (python3 >= 3.11 with venv, make, g++):
#   make demo    build, install into .venv, run the whole pipeline on the shipped sample
#   make test    build, install into .venv, run the quick tests against the installed wheel
#   make test-all   all that CI runs
PYTHON ?= python3
VENV   ?= .venv
PYTEST_ARGS ?= -n 2 --dist loadfile
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.vfplan-installed
SOURCES := pyproject.toml README.md LICENSE \
           $(shell find vfplan cli schemas samples -type f -not -path '*/__pycache__/*' 2>/dev/null)

.PHONY: franka franka-env demo test test-all test-full docs site api pictures lint format install lock sbom wasm wheel clean
install: $(VENV)/.vfplan-test

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q --upgrade pip
	$(if $(CI),$(BIN)/python -m pip install -q --require-hashes -r requirements-ci.txt)

$(VENV)/.vfplan-tools: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install -q --group build
	touch $@

$(STAMP): $(SOURCES) | $(VENV)/.vfplan-tools
	rm -rf build/wheel
	$(BIN)/python -m pip wheel -q --no-build-isolation --no-deps -w build/wheel .
	$(BIN)/python -m pip install -q --no-deps --force-reinstall build/wheel/*.whl
	$(BIN)/python -m pip install -q "$$(ls build/wheel/*.whl)"
	touch $@

# What the tests need on top: the extras of the same wheel.
$(VENV)/.vfplan-test: $(STAMP)
	$(BIN)/python -m pip install -q "$$(ls build/wheel/*.whl)[all,test]"
	touch $@

demo: $(STAMP)
	$(BIN)/vfplan demo -o demo --overwrite

test: $(VENV)/.vfplan-test
	$(BIN)/pytest $(PYTEST_ARGS)

# Everything that CI runs: also what compiles C++, fuzzes, or sweeps many cases.
test-all: $(VENV)/.vfplan-test
	$(BIN)/pytest $(PYTEST_ARGS) --all

test-full: $(VENV)/.vfplan-test
	$(BIN)/pytest $(PYTEST_ARGS) --full

docs: $(VENV)/.vfplan-test
	$(BIN)/python docs/make_cli.py
	$(BIN)/python docs/make_findings.py
	$(BIN)/python docs/make_formats.py
	$(BIN)/python docs/make_format.py
	$(BIN)/python docs/make_conformance.py
	$(BIN)/python docs/make_transcripts.py

# These pages as a site with search that needs no network: build/site/index.html.
site: | $(BIN)/python
	$(BIN)/python -m pip install -q --group site
	rm -rf build/site
	$(BIN)/sphinx-build -q -W --keep-going -n -d build/doctrees -b html docs build/site
	cp build/site/README.html build/site/index.html

# The reference of Python (pdoc) and C++ (apt package doxygen), as pages under build/api.
api: $(VENV)/.vfplan-test
	$(BIN)/python -m pip install -q "pdoc>=15"
	$(BIN)/python -P docs/make_api.py

pictures: $(VENV)/.vfplan-test
	$(BIN)/python docs/make_pictures.py
	$(BIN)/python docs/make_readme_film.py
	$(BIN)/python docs/make_finding_pictures.py
	$(BIN)/python docs/make_camera.py
	$(BIN)/python docs/make_review.py
	$(BIN)/python docs/draw_algorithm.py
	$(BIN)/python docs/draw_house.py

lint: | $(BIN)/python
	$(BIN)/python -m pip install -q --group lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	find vfplan/native samples tests -name '*.hpp' -o -name '*.cpp' | xargs -r $(BIN)/clang-format --dry-run --Werror

format: | $(BIN)/python
	$(BIN)/python -m pip install -q --group lint
	-$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	find vfplan/native samples tests -name '*.hpp' -o -name '*.cpp' | xargs -r $(BIN)/clang-format -i

# Anew: every package that CI installs (CI=true), and the simulator's, fixed by its hash.
LOCKED = $(BIN)/uv pip compile -q --universal --upgrade --generate-hashes --python-version 3.11 \
  --custom-compile-command "make lock"
lock: | $(BIN)/python
	$(BIN)/python -m pip install -q uv
	$(LOCKED) pyproject.toml --all-extras --group build --group lint --group site --group wasm \
	  -o requirements-ci.txt
	$(LOCKED) --group franka -o requirements-franka.txt

# The engine for pages, by a compiler of one version: the same sources give the same bytes.
wasm: | $(BIN)/python
	$(BIN)/python -m pip install -q --group wasm
	$(BIN)/python release/make_wasm.py

# The wheel, with the time of the commit in it: the same commit and toolchain give the same bytes.
wheel: $(VENV)/.vfplan-tools
	SOURCE_DATE_EPOCH=$${SOURCE_DATE_EPOCH:-$$(git log -1 --format=%ct)} \
	  $(BIN)/python -m pip wheel -q --no-build-isolation --no-deps -w dist .
	sha256sum dist/*.whl

# The parts that an install brings along, as CycloneDX JSON.
sbom: $(VENV)/.vfplan-test
	mkdir -p dist
	SOURCE_DATE_EPOCH=$${SOURCE_DATE_EPOCH:-$$(git log -1 --format=%ct)} \
	  $(BIN)/python release/make_sbom.py dist/vfplan.cdx.json --all

# A Franka's own protocol against its simulator, in an environment of its own (numpy 1, mujoco < 3.3).
FRANKA := .venv-franka
$(FRANKA)/.simulator: requirements-franka.txt
	$(PYTHON) -m venv $(FRANKA)
	$(FRANKA)/bin/python -m pip install -q --require-hashes -r requirements-franka.txt
	touch $@

franka-env: $(FRANKA)/.simulator $(STAMP)
	$(FRANKA)/bin/python -m pip install -q --no-deps --force-reinstall build/wheel/*.whl

franka: franka-env
	$(FRANKA)/bin/python samples/franka/study.py

clean:
	rm -rf build dist $(VENV) $(FRANKA)
