# Needs python3 (3.11 or newer) and make. `uv` is used if it is installed,
# otherwise a private copy goes to .uv; the environment is .venv, made from uv.lock.
UV := $(shell command -v uv 2>/dev/null || echo .uv/bin/uv)
# Compiled once here instead of by every process of the tests.
SYNC = UV_PROJECT_ENVIRONMENT=.venv UV_COMPILE_BYTECODE=1 $(UV) sync --locked --inexact --quiet
RUN = .venv/bin

.PHONY: help env demo test slow check bench docs pictures schemas cards wakes wheel clean

help:
	@echo "make env    the environment, in .venv; EXTRAS=view,weather adds extras"
	@echo "make demo   thermal frames of the built-in figurine, in results/demo"
	@echo "make test   the test suite        make slow   the long tests"
	@echo "make check  lint and types        make bench  the benchmarks"
	@echo "make docs   the documentation, in results/docs"
	@echo "make cards  the fit cards of the package, after a change of configs/cards"
	@echo "make wakes  the data of wakes, after a change of the flow"
	@echo "make wheel  the wheel, in results/dist"
	@echo "make schemas  the JSON Schemas in configs, after a change of a model"

.uv/bin/uv:
	@python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
	  || { echo "jaxthermo needs python3 >= 3.11; this is `python3 --version`"; exit 1; }
	@python3 -m venv .uv && .uv/bin/pip install --quiet uv \
	  || { rm -rf .uv; echo "could not set up uv: install python3-venv, or uv itself, and try again"; exit 1; }

.venv/.core: uv.lock pyproject.toml $(filter .uv/%,$(UV))
	@$(SYNC) && touch $@

.venv/.test: uv.lock pyproject.toml $(filter .uv/%,$(UV))
	@$(SYNC) --extra test && touch $@ .venv/.core

.venv/.dev: uv.lock pyproject.toml $(filter .uv/%,$(UV))
	@$(SYNC) --extra test --extra dev --extra docs && touch $@ .venv/.test .venv/.core

.venv/.docs: uv.lock pyproject.toml $(filter .uv/%,$(UV))
	@$(SYNC) --extra docs && touch $@ .venv/.core

# EXTRAS=view,weather adds extras; those that are there stay.
EXTRAS =
comma = ,
env: .venv/.core
	@test -z '$(EXTRAS)' || $(SYNC) $(foreach extra,$(subst $(comma), ,$(EXTRAS)),--extra $(extra))

demo: .venv/.core
	$(RUN)/jaxthermo simulate configs/scenes/figurine.yaml --out results/demo

test: .venv/.test
	$(RUN)/python -m pytest -n auto --dist worksteal

slow: .venv/.test
	XLA_FLAGS= $(RUN)/python -m pytest -m slow

check: .venv/.dev
	$(RUN)/ruff check .
	$(RUN)/ruff format --check .
	$(RUN)/pyright --pythonpath $(RUN)/python

bench: .venv/.test
	$(RUN)/python -m experiments run benchmarks

# Readable without network; a warning is an error.
docs: .venv/.docs
	$(RUN)/python -m sphinx -W --keep-going -q -b html docs results/docs

# Needs Chromium for the picture of the live view.
pictures: .venv/.test
	PYTHONPATH=. $(RUN)/python docs/make_pictures.py
	PYTHONPATH=. $(RUN)/python docs/make_live_picture.py

schemas: .venv/.core
	$(RUN)/python -m jaxthermo schema > configs/scene.schema.json
	$(RUN)/python -m jaxthermo schema dataset > configs/dataset.schema.json
	$(RUN)/python -m calibrate schema > configs/calibration.schema.json
	$(RUN)/python -m experiments schema > configs/sweep.schema.json

# Half an hour of one core; a slow test checks what ships.
wakes: .venv/.core
	$(RUN)/python -m experiments run wake-data --out results/wake-data
	cp results/wake-data/wake_profiles.csv results/wake-data/wake_fit.csv jaxthermo/data

# Those that are up to date stay; a fit that was interrupted continues. Needs the meshes.
cards: .venv/.core
	$(RUN)/python -m calibrate cards configs/cards --out jaxthermo/data/cards

wheel: pyproject.toml $(filter .uv/%,$(UV))
	$(UV) build --quiet --wheel --out-dir results/dist

clean:
	rm -rf .venv .uv results .jax_cache
