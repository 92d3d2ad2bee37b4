# Every target prepares what it needs: on a Debian machine `make run` or `make test` is the only thing to type.
# PYTHON: the interpreter that .venv is made with. CASE: what `make run` runs. SWEEP, ON (local or slurm) and CLUSTER:
# what `make sweep` runs, and where. GRANPIPE: a granpipe that is there already (from a module, or an environment on a
# shared file system), to be used as it is: then nothing is set up.
PYTHON ?= python3
CASE ?= cases/reactor.yaml
SWEEP ?= cases/sweeps/hopper.yaml
ON ?= local
CLUSTER ?= cluster.yaml

VENV := .venv

.DEFAULT_GOAL := help
.PHONY: help setup ready run sweep status cancel study study-reactor test test-cluster verify fuzz stability benchmarks docs lock clean

help:
	@echo 'make setup       Debian packages that are missing, and the virtual environment .venv'
	@echo 'make run         setup, then granpipe run $$(CASE) [$(CASE)]'
	@echo 'make sweep       setup, then granpipe sweep run $$(SWEEP) --on $$(ON) [$(SWEEP), $(ON)]'
	@echo 'make status      how the points of $$(SWEEP) stand; make cancel ends them'
	@echo 'make study       setup, then a small study of the smoke scene: error against time; a few minutes'
	@echo 'make study-reactor  setup, then the study of the test reactor, some hours; writes docs/validation/study_reactor.md'
	@echo 'make test        setup, then ruff, mypy and every test that is not slow'
	@echo 'make test-cluster  setup, a Slurm of two nodes on this machine (as root), and a sweep on it'
	@echo 'make verify      setup, then the slow tests, fuzz and test-cluster'
	@echo 'make fuzz        setup, then 100 000 damaged inputs for each reader'
	@echo 'make stability   setup, then the stability suite, half an hour; writes docs/validation/stability.md'
	@echo 'make benchmarks  setup, then everything in benchmarks/; writes docs/validation/benchmarks*.md'
	@echo 'make docs        makes docs/reference/case.md anew, from the schema'
	@echo 'make lock        makes requirements.lock anew, from the newest versions'
	@echo 'make clean       removes caches and builds; keeps .venv and results'

setup:
	@PYTHON='$(PYTHON)' .ci/setup

ifdef GRANPIPE
ready:
else
GRANPIPE := $(VENV)/bin/granpipe
ready: setup
endif

run: ready
	$(GRANPIPE) run $(CASE)

sweep: ready
	$(GRANPIPE) sweep run $(SWEEP) --on $(ON) --cluster $(CLUSTER)

status cancel: ready
	$(GRANPIPE) sweep $@ $(SWEEP)

# particles of 2 cm stand for those of 1.8 cm
study: ready
	$(GRANPIPE) study cases/smoke.yaml --hours 0.08 --axis coarse_grain_factor=1 --axis plate_speed --axis facets \
	    --axis replicas --axis seed --set 'material.size={diameter: 1.8 cm}' --set dem.coarse_grain_factor=1.111 \
	    --set 'dem.max_time=4 s' --set 'homogenize.start=1 s'

study-reactor: setup
	$(VENV)/bin/granpipe study cases/reactor.yaml --hours 6 --set 'dem.max_time=30 s' --against cases/reactor_paper.yaml \
	    --axis model=hybrid,fluid --axis coarse_grain_factor=1.5,2.5,3 --axis plate_speed=0.05,0.1,0.2 --axis cheap \
	    --axis youngs_modulus=5e6 --axis reservoir_height=0.53 --axis seed
	$(VENV)/bin/python benchmarks/study.py results/reactor-study

test: setup
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy
	$(VENV)/bin/python -m pytest -m 'not slow and not cluster'

test-cluster: setup
	.ci/cluster
	$(VENV)/bin/python -m pytest -m cluster -x

verify: setup fuzz test-cluster
	$(VENV)/bin/python -m pytest -m slow

fuzz: setup
	$(VENV)/bin/python -m pytest tests/fuzz --inputs 100000

stability: setup
	PYTHONPATH=benchmarks $(VENV)/bin/python -m stability --out docs/validation

benchmarks: setup
	$(VENV)/bin/python benchmarks/run.py
	$(VENV)/bin/python benchmarks/fluid.py
	$(VENV)/bin/python benchmarks/force_factor.py
	$(VENV)/bin/python benchmarks/dem_settings.py

docs: setup
	$(VENV)/bin/python -c 'from granpipe.case.reference import reference; print(reference(), end="")' >docs/reference/case.md
	$(VENV)/bin/python -c 'from granpipe.pipeline.gates_page import gates_page; print(gates_page(), end="")' >docs/reference/gates.md

lock:
	@PYTHON='$(PYTHON)' .ci/lock

clean:
	rm -rf build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find granpipe tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
