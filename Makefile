# One word per task. Each makes its own environment; nothing but Python >= 3.11 and make is needed.
PYTHON ?= python3
VENV := .venv
MINUTES ?= 10
FRAMES ?= 0:315
BIN := $(VENV)/bin
NODE := viewer/node_modules/.package-lock.json
PAGE := src/signsplice/service/page/index.html
PAGE_SOURCES := $(shell find viewer/src) $(wildcard viewer/*.json) viewer/build.mjs
PIP := $(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check
LOCKED := $(PIP) --only-binary :all: --require-hashes --requirement
ITSELF := $(PIP) --no-deps --no-build-isolation --editable .
PLACES := src tests examples workshop research viewer conftest.py
COMPILE := $(VENV)/lock/bin/uv pip compile --quiet --universal --python-version 3.11 --fork-strategy fewest --generate-hashes \
	--only-binary :all: --no-annotate --custom-compile-command "make lock" $(if $(UPGRADE),--upgrade)

.PHONY: attacks demo test test-slow lint types unit viewer player wheel try-wheel lowest lock bench fuzz words corpus measured smoke paper weights pictures clean

demo: $(VENV)/.demo            ## splice the words that ship, and leave a BVH, a GIF, a sheet, a report and an avatar in out/demo
	@$(MAKE) --no-print-directory viewer || echo "the viewer is not built: \`view\` needs it"
	@$(BIN)/signsplice demo --out out/demo

test: lint types unit          ## style, types and the fast tests: minutes on two cores

test-slow: $(VENV)/.dev $(PAGE) ## the tests that take long; CI runs them too
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses auto --dist loadfile -m slow

lint: $(VENV)/.dev             ## style
	$(BIN)/ruff check $(PLACES)
	$(BIN)/ruff format --check $(PLACES)

types: $(VENV)/.dev            ## mypy --strict
	$(BIN)/mypy

viewer: $(PAGE)                ## the browser viewer's page, built into the package (needs Node 20 or newer)

player: $(NODE)                ## the package of <sign-player>, the web component, in out (needs Node)
	mkdir -p out
	cd viewer && npm run --silent player && npm pack --silent --pack-destination ../out

wheel: $(VENV)/.dev $(PAGE)    ## wheel and source archive in out/dist, with their hashes and what they were made of
	$(BIN)/python workshop/runs/release.py

try-wheel: wheel               ## the wheel used in a clean environment on every Python from 3.11 to 3.13 that is here
	workshop/runs/try_wheel.sh

lowest: $(PAGE) | $(VENV)/bin/python ## the oldest versions that pyproject.toml declares, in a clean environment (needs an index)
	$(BIN)/python -m venv $(VENV)/lock
	$(VENV)/lock/bin/python -m pip install --quiet --disable-pip-version-check uv
	$(VENV)/lock/bin/python workshop/runs/lowest_versions.py

lock: | $(VENV)/bin/python     ## requirements/*.lock anew from pyproject.toml; UPGRADE=1 for newer versions (needs an index)
	$(BIN)/python -m venv $(VENV)/lock
	$(VENV)/lock/bin/python -m pip install --quiet --disable-pip-version-check uv==0.13.9
	$(COMPILE) pyproject.toml --extra dev --no-emit-package torch --output-file requirements/dev.lock
	echo hatchling | $(COMPILE) pyproject.toml - --extra video --constraint requirements/dev.lock \
		--output-file requirements/demo.lock
	echo hatchling | $(COMPILE) pyproject.toml - --extra serve --constraint requirements/dev.lock \
		--output-file requirements/serve.lock

unit: $(VENV)/.dev $(PAGE)     ## pytest, a process a core; each file's tests stay together
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest --numprocesses auto --dist loadfile

bench: $(VENV)/.dev            ## speed of every part beside its baselines, in one run
	$(BIN)/signsplice bench

attacks: $(VENV)/.fuzz $(PAGE)  ## the tables of workshop/docs/reliability.md: floods, kills, broken files, odd rigs; half an hour
	for attack in formats rigs floods kills; do $(BIN)/python workshop/attacks/$$attack.py || exit; done
	$(BIN)/python workshop/attacks/fuzz.py --cases 20000 --seed 18

fuzz: $(VENV)/.fuzz            ## every reader against mutated files for MINUTES=10; what is found stays in workshop/tests/fuzz_corpus
	$(BIN)/python workshop/attacks/fuzz.py --minutes $(MINUTES)

words: $(VENV)/.dev            ## sign the words that ship anew, from their notation
	mkdir -p out
	$(BIN)/signsplice synth lexicon -o out/words
	$(BIN)/signsplice lexicon build out/words -o src/signsplice/lexicon/words --compact

corpus: $(VENV)/.dev           ## 10,000 true splices, and workshop/docs/measured/corpus.md and its pictures; REAL=DIR adds real clips, FRAMES=0:315 part of each
	mkdir -p out
	$(BIN)/signsplice synth pairs -o out/pairs
	$(BIN)/signsplice evaluate corpus out/pairs --page workshop/docs/measured/corpus.md --images workshop/docs/images $(if $(REAL),--real $(REAL) --real-frames $(FRAMES))

measured: $(VENV)/.dev         ## every page of workshop/docs/measured but scale, from committed sources; REAL=DIR: clips of real signing. It continues
	nice $(BIN)/python workshop/runs/measured.py $(if $(REAL),--real $(REAL))

measured-%: $(VENV)/.dev       ## one page of workshop/docs/measured: seams hidden-frames collisions bodies tempo bench corpus scale
	nice $(BIN)/python workshop/runs/measured.py $* $(if $(REAL),--real $(REAL))

smoke: $(VENV)/.dev            ## the paper's whole way in minutes, systems of a few thousand numbers: out/smoke
	research/runs/smoke.sh

paper: $(VENV)/.dev            ## the paper whole at cpu scale: hours; SCALE=paper for its sizes, on a GPU
	research/runs/paper.sh

weights: $(VENV)/.dev          ## make the networks that ship, from nothing, in parts: two hours; PARTS="networks ship" makes these
	$(BIN)/python workshop/runs/weights.py $(PARTS)

pictures: $(VENV)/.dev $(PAGE) ## the pictures of docs and README anew (needs Node and Chromium)
	CHROMIUM=$${CHROMIUM:-$$(command -v chromium)} $(BIN)/python workshop/runs/pictures.py docs/images

clean:                         ## forget the environment and everything made
	rm -rf $(VENV) out .mypy_cache .ruff_cache .pytest_cache .hypothesis

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "signsplice needs Python 3.11 or newer; set PYTHON=python3.x")'
	$(PYTHON) -m venv $(VENV)

$(NODE): viewer/package-lock.json
	@if command -v npm >/dev/null; then cd viewer && npm ci --no-audit --no-fund --silent; \
	else echo "no npm: what other programs make of our glTF files is not tested"; fi

$(PAGE): $(NODE) $(PAGE_SOURCES)
	@if command -v npm >/dev/null; then cd viewer && npm run --silent build; \
	else echo "no npm: the viewer is not built, nor tested"; fi

$(VENV)/.demo: pyproject.toml requirements/demo.lock | $(VENV)/bin/python
	@echo "installing requirements/demo.lock into $(VENV)"
	@$(LOCKED) requirements/demo.lock
	@$(ITSELF)
	@touch $@

# torch has a build for CPUs and builds for each CUDA, and which one comes depends on the index that pip is set to. So its
# version is fixed, in pyproject.toml, and its hash is not. What it needs besides CUDA libraries is in the lock.
$(VENV)/.dev: pyproject.toml workshop/pyproject.toml research/pyproject.toml requirements/dev.lock | $(VENV)/bin/python
	$(LOCKED) requirements/dev.lock
	$(PIP) $$(sed -n 's/.*"\(torch==[^"]*\)".*/\1/p' pyproject.toml)
	$(ITSELF) --editable ./workshop --editable ./research
	touch $@ $(VENV)/.demo

$(VENV)/.fuzz: $(VENV)/.dev
	@$(PIP) --only-binary :all: $$(sed -n 's/.*"\(atheris[^;"]*\).*/\1/p' pyproject.toml) \
	|| echo "no atheris for this machine: nothing can be fuzzed"
	touch $@
