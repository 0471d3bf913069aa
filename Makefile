# `make demo` and `make test` are all a newcomer needs; `make help` lists the rest.
# S passes Hydra overrides on:  make params S="clip=carp extract.noise_sigmas=6"

VENV := .venv
BIN := $(CURDIR)/$(VENV)/bin
PIP := $(VENV)/bin/python -m pip --quiet --disable-pip-version-check
TOOLS := $(VENV)/tools
LOCKS := requirements.lock requirements-tests.lock requirements-torch.lock
ORIGIN := { cat $(LOCKS); echo "$(CURDIR)"; }
OUTSIDE := $(subst $(BIN):,,$(PATH))
export PATH := $(BIN):$(PATH)

# The first interpreter that the packages are made for, looked for outside the environment it is to create.
PYTHON ?= $(shell PATH="$(OUTSIDE)"; for p in python3 python3.11 python3.12 python3.13 python; do \
	"$$p" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null \
	&& command -v "$$p" && break; done)

.DEFAULT_GOAL := help
TARGETS := help demo film study ci-fixture test test-kernel setup tracks cluster params repro verify pull play blind stimulus runs sweep lint params-check bench docs pictures lock sbom clean
.PHONY: $(TARGETS)

# A second film beside FILM, or half of a path with a space, is a target to make: it would be left out in silence.
STRAY := $(if $(filter film,$(MAKECMDGOALS)),$(filter-out $(TARGETS),$(MAKECMDGOALS)))
ifneq ($(STRAY),)
$(error finloop: $(STRAY) is not part of FILM. Wanted: make film FILM=/path/of/film.mp4; several, or a path with a space, in quotes: FILM="a.mp4 'b c.mp4'")
endif

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' Makefile | expand -t 22

demo: display setup ## fetch the zebrafish clip, run the pipeline on it, say what to open
	@dvc repro
	@echo
	@echo "Done. Open:"
	@echo "  reports/index.html                        everything on one page"
	@echo "  data/tank/tank.html                       the tank in three dimensions, to turn"
	@echo "  data/render/modes.mp4                     the film and all modes, side by side"
	@echo "  data/render/hybrid_marked.mp4             mode hybrid on its way to A, B and C"
	@echo "  reports/modes/render/<mode>.png           the route of each mode, in colours by what is shown"
	@echo "  reports/modes/render/switches.png         mode hybrid between film and sprites, tick by tick"
	@echo "  reports/motion/loops/fig11.png            the position table of the video loops"
	@echo "  data/animate/beside/measures.csv          the measures of all modes, beside the film's own"
	@echo "  reports/motion/sprites/contact_sheet.png  the frames that network and hybrid show"
	@echo "  reports/film/features/contact_sheet.png   the fish, with what was found in them"
	@echo "  reports/features/metrics.json             the numbers (of others: dvc metrics show)"
	@echo "  dvc_plots/index.html                      every chart and picture"
	@echo "Then: make play                             send the fish by hand"
	@dvc plots show >/dev/null

film: display setup ## your own film, from file to report:  make film FILM=/path/of/film.mp4
	@FILM='$(subst ','\'',$(value FILM))' python -m stages.film $(S)
	@dvc repro
	@python -m stages.film --report

study: display setup ## several films, a row each:  make study FILMS="a.mp4 b.mp4", or FILMS=study.yaml
	@FILMS='$(subst ','\'',$(value FILMS))' python -m stages.study $(S)

ci-fixture: display setup ## the pipeline on a tiny drawn film, its numbers against kept ones
	@python -m stages.fixture $(S)

test: setup ## run the tests
	@python -m pytest -n 2 --dist loadfile --no-loadscope-reorder

# Products, decompositions, training and complex numbers: an older processor rounds them differently, one thread sums in another order.
NUMERICAL := distance_map jumps bpn forecast pose puppet tracks curve curve_dynamics curve_stiffness curve_wavelet gait_fit gait_limbs gait_outline gait_period calibrate social rule retarget

test-kernel: setup ## run the numerical tests as an older processor computes, half a minute
	@OPENBLAS_CORETYPE=Prescott ATEN_CPU_CAPABILITY=default FINLOOP_THREADS=1 OPENBLAS_NUM_THREADS=1 \
	NPY_DISABLE_CPU_FEATURES=X86_V3,X86_V4,AVX512_ICL GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX2,-FMA \
	python -m pytest -n 2 --dist loadfile $(NUMERICAL:%=tests/test_%.py)

.PHONY: display
display:
	@test "$$(uname)" != Linux || test -z "$(PYTHON)" || $(PYTHON) -c 'import ctypes.util, sys; sys.exit(not any(map(ctypes.util.find_library, ("EGL", "OSMesa"))))' \
	|| { echo "finloop: neither libEGL nor libOSMesa is there, and the stage tank draws with one of them; install it (apt-get install libegl1)"; exit 1; }

# The environment is made anew when a lock or the folder is not the one that it was made from.
setup: ## create .venv from requirements.lock and its two neighbours, once
	@$(ORIGIN) | cmp -s - $(VENV)/origin || $(MAKE) --no-print-directory $(VENV)
	@git rev-parse --git-dir >/dev/null 2>&1 || git init --quiet .  # DVC wants a repository

.PHONY: $(VENV)
$(VENV):
	@test ! -L $(VENV) || { echo "finloop: $(VENV) is a link to $$(readlink $(VENV)), an environment of another folder, which a new one would empty; remove the link (rm $(VENV)), then: make setup"; exit 1; }
	@command -v git >/dev/null || { echo "finloop: git is missing; install it (apt-get install git)"; exit 1; }
	@test -n "$(PYTHON)" || { echo "finloop: Python 3.11, 3.12 or 3.13 is wanted; install one, or: make PYTHON=/path/to/python3 setup"; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "finloop: $(PYTHON) lacks the venv module; install it (apt-get install python3-venv)"; exit 1; }
	@echo "Creating $(VENV) with $$($(PYTHON) --version); about 180 packages, PyTorch among them, some minutes ..."
	@rm -f $(VENV)/origin
	@$(PYTHON) -m venv --clear $(VENV)
# Every package is the file that was locked, or pip refuses it. Two at once take two thirds of the time of one.
	@awk '/^[a-z]/ {half = 1 - half} half != "" {print > "$(VENV)/lock" half}' requirements.lock requirements-tests.lock
	@printf '%s\n' 0 1 | xargs -P 2 -I{} $(PIP) install --no-compile --require-hashes --no-deps --requirement $(VENV)/lock{}
	@$(PIP) install --no-compile --requirement requirements-torch.lock
	@rm $(VENV)/lock0 $(VENV)/lock1
# Bytecode by every core, which pip would make by one, for a minute; files that are no Python of today are left out,
# and so are the packages' own tests and plotly, which nothing here imports.
	@$(VENV)/bin/python -m compileall -q -j 0 -x '/(tests?|plotly)/' $(VENV)/lib >/dev/null 2>&1 || true
# DVC runs a stage as `python ...`: this makes $(VENV)/bin/dvc find the right one without PATH.
	@$(VENV)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))' | while read -r site; do \
	echo 'import os, sys; os.environ["PATH"] = os.path.join(sys.prefix, "bin") + os.pathsep + os.environ.get("PATH", os.defpath)' > "$$site/finloop_path.pth"; done
	@$(ORIGIN) > $(VENV)/origin

tracks: setup ## install what reads and writes other programs' tracks (the extra `tracks`)
	@$(PIP) install --require-hashes --no-deps --requirement requirements-tracks.lock

cluster: setup ## install Dask, to work on several machines (the extra `cluster`)
	@$(PIP) install --require-hashes --no-deps --requirement requirements-cluster.lock

params: setup ## compose conf/ into params.yaml, after editing conf/
	@python -m stages.compose $(S)

repro: setup ## run what has changed, a film or its tracks, too
	@python -m stages.stamps
	@dvc repro

verify: setup ## compare all results with their checksums, after a power cut
	@python -m stages.verify

pull: setup ## take over the results that a colleague has pushed, after git pull; then no stage runs again
	@python -m stages.pull $(S)

play: setup ## send the fish by hand, on a local page:  make play S="--fish 4"
	@python -m stages.play $(S)

blind: setup ## a blind test for people, docs/blind.md:  make blind MODE=matching; then make blind ANSWERS="a.csv b.csv"
	@python -m stages.blind --mode '$(MODE)' --answers '$(subst ','\'',$(value ANSWERS))' $(S)

stimulus: setup ## a stimulus for animals, see docs/stimulus.md:  make stimulus S="show examples/protocol.yaml"
	@python -m stages.stimulus $(S)

sweep: setup ## make sweep experiment=learning_rate (conf/experiment/), or S="bpn.hidden_units=10,20 bpn.momentum=0.3,0.5"
	@SWEEP='$(subst ','\'',$(value S))' python -m stages.sweep $(experiment)

# By name: of each mode how real it looks and the goals that it reaches; hybrid's seams; the network's error.
MODES = $(shell $(BIN)/python -c 'from finloop.edit.modes import MODES; print(*MODES)')
CHIEF = $(foreach mode,$(MODES),$(mode)_auc $(mode)_trials_goals_reached_pct) hybrid_seam_ratio_p95 held_out_area_rmse
NONE :=

runs: setup ## experiments, a row each: changed parameters, the numbers that matter;  make runs S="--sort-by hybrid_auc"
	@COLUMNS=300 dvc exp show --only-changed --drop '^[^.]*$$|.*/|^params' --keep '^(Experiment|Created|$(subst $(NONE) $(NONE),|,$(CHIEF)))$$' $(S)

lint: setup ## style, types, and which room may import which
	@ruff check
	@ruff format --check
	@mypy
	@PYTHONPATH=. lint-imports

params-check: setup ## is params.yaml the composition of conf/?
	@python -m stages.compose --check

bench: setup ## measure speed and memory, as ratios in one run
	@python -m benchmarks

docs: setup ## README, guides, parameters and API as a site to read without a network (the extra `docs`)
	@$(PIP) install --require-hashes --no-deps --requirement requirements-docs.lock
	@python -m stages.parameters --write
	@NO_MKDOCS_2_WARNING=1 python -m mkdocs build --strict --quiet
	@echo "Done. Open site/index.html"

pictures: display setup ## draw every picture of the README and the guides anew; wants chromium
	@python -m docs.draw

$(TOOLS): requirements-tools.lock
	@python -m venv --clear $(TOOLS)
	@$(TOOLS)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps --requirement $<

COMPILE = $(TOOLS)/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-annotate \
	--custom-compile-command "make lock" --constraint requirements-torch.lock --no-emit-package torch $(S)

lock: setup $(TOOLS) ## write the requirements*.lock anew from pyproject.toml, with hashes;  make lock S=--upgrade
	@$(COMPILE) pyproject.toml --output-file requirements.lock
	@$(COMPILE) --group tools --output-file requirements-tools.lock
	@$(COMPILE) --no-deps requirements-tracks.in --output-file requirements-tracks.lock
	@beside="--constraint requirements.lock $$(sed -n 's/^\([a-z0-9.-]*\)==.*/--no-emit-package \1/p' requirements.lock)"; \
	$(COMPILE) $$beside --group tests --output-file requirements-tests.lock && for extra in cluster docs; do \
	$(COMPILE) $$beside pyproject.toml --extra $$extra --output-file requirements-$$extra.lock || exit 1; done

sbom: setup $(TOOLS) ## list all packages and their licences: sbom.cdx.json (CycloneDX), docs/licences.md
	@$(TOOLS)/bin/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --output-file sbom.cdx.json $(BIN)/python
	@python -m docs.licences sbom.cdx.json

clean: ## remove results and caches; DVC's cache and .venv stay
	@git clean -Xdfq reports data
	@rm -rf dvc_plots site .import_linter_cache .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
