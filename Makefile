# make book    the book as a site, from executed chapters, and the scoreboard of its claims
# make test    everything that CI checks
# make lab     lessons, exercises and solutions in JupyterLab, in the folder lab
# make reset EXERCISE=03_mpc   that exercise as it was; yours is kept beside it
# make exercises             the exercises, from their solutions
# make homework              the labs for a course: notebooks for students, keys, autograders
# make page CHAPTER=03_mpc   one page alone, run and built (exercises/03_mpc, solutions/03_mpc)
# make slides  a deck for each chapter, in build/slides, from book/slides
# make pdf     the whole book as one PDF, build/book.pdf, by a headless Chromium
# make picture               the README's pictures: the opening page's film, and a dog with legs
# make bench   speed beside other libraries, as ratios: makes the book's page of them anew, and the
#              record of chapter 10
# make other-tools   the same plan by other tools, recorded for the book's page of them
# make wheel   the wheel, in dist/; with TAG=v0.1.0 only if that is its version
# make workflows             lints what .github runs
# make library, claims, newest: steps of .github/workflows, which say what they are for
# make clean   removes what these made, .venv excepted

SHELL := /bin/sh
.DELETE_ON_ERROR:
.PHONY: book test lab reset exercises homework page picture bench other-tools clean lint chapters site
.PHONY: slides pdf install wheel workflows library claims newest

PYTHON ?= python3
BIN := .venv/bin
INSTALLED := .venv/.installed
export OMP_NUM_THREADS ?= 1
export PATH := $(CURDIR)/$(BIN):$(PATH)
export PYTHONUTF8 := 1# files and screens are UTF-8, in any locale
export PYTHONPATH := $(CURDIR)# not packages of ROS and the like, which are for another Python
unexport PYTHONHOME MPLBACKEND# a kernel has a backend of its own, which shows figures
ifneq ($(shell test -w "$$HOME" && echo yes),yes)# what is kept between runs needs a place
export HOME := $(CURDIR)/build/home
$(shell mkdir -p build/home)
endif

LIBRARY := $(shell find pypose_lite -path pypose_lite/teaching/site -prune -o \
  \( -name '*.py' -o -name '*.json' \) -print)
SOURCES := $(wildcard book/*.py) $(wildcard solutions/[0-9][0-9]_*.py)
NOTEBOOKS := $(patsubst %.py,build/executed/%.ipynb,$(SOURCES:book/%=%))
TODO := build/executed/.todo
HTML := build/site/_build/html
BUILD_SITE := python -m pypose_lite.teaching.site.build

book: site
	@python -m pypose_lite.teaching.site.scoreboard build/executed
	@printf '\nThe book: file://%s\n' "$(CURDIR)/$(HTML)/index.html"

test: lint site .venv/.installed-grading
	pytest book $(wildcard solutions) -q -n 2 --dist loadfile
	python -m pypose_lite.teaching.site.scoreboard build/executed build/claims
	pytest tests -q -n 2 --dist loadfile -m "not wall_clock"
	pytest tests/go1 -q -m wall_clock --reruns 9 --reruns-delay 10 --only-rerun Busy

lint: .venv/.installed
	ruff check
	ruff format --check
	mypy

site: chapters build/npm/.complete
	@python -m pypose_lite.teaching.site.stage build/executed build/book
	@cp -Rp build/npm/static build/npm/extra build/book
	@$(BUILD_SITE) build/book build/site -W -n --keep-going
	@cp -Rp build/book-notebooks/. $(HTML)/_sources/

# Chapters run side by side, one process for each of two cores; each is run again only when it or
# the library has changed.
chapters: .venv/.installed
	@rm -f $(filter-out $(NOTEBOOKS),$(wildcard build/executed/*.ipynb build/executed/*/*.ipynb))
	@mkdir -p build/executed
	@$(MAKE) -n INSTALLED= $(NOTEBOOKS) | sed -n 's/.*site\.execute [^ ]* \([^ ]*\).*/\1/p' > $(TODO)
	@$(MAKE) -s -j2 INSTALLED= $(NOTEBOOKS)
	@rm -f $(TODO)

build/executed/%.ipynb: book/%.py pypose_lite/teaching/site/execute.py $(LIBRARY) $(INSTALLED)
	@python -m pypose_lite.teaching.site.execute $< $@ $(wildcard $(TODO))

build/executed/solutions/%.ipynb: solutions/%.py pypose_lite/teaching/site/execute.py $(LIBRARY) $(INSTALLED)
	@python -m pypose_lite.teaching.site.execute $< $@ $(wildcard $(TODO))

build/npm/.complete: .venv/.installed
	@python -m pypose_lite.teaching.site.assets build/npm

.venv/.installed: pyproject.toml constraints.txt requirements-vendor.txt .ci/install
	@.ci/install $(PYTHON)

exercises: .venv/.installed
	@python -m pypose_lite.teaching.site.exercises solutions exercises

# SEED=1234 draws other hidden numbers; ONLY=3.1,3.2 leaves the other exercises out.
homework: .venv/.installed-grading
	@python -m pypose_lite.teaching.grading.homework solutions build/homework \
	  $(if $(SEED),--seed=$(SEED)) $(if $(ONLY),--only=$(ONLY))

page: $(filter build/executed/$(CHAPTER).ipynb,$(NOTEBOOKS)) build/npm/.complete
	@python -m pypose_lite.teaching.site.stage build/executed build/page $(CHAPTER)
	@cp -Rp build/npm/static build/npm/extra build/page
	@$(BUILD_SITE) build/page build/page
	@cp -Rp build/page-notebooks/. build/page/_build/html/_sources/
	@printf '\nThe page: file://%s\n' "$(CURDIR)/build/page/_build/html/$(CHAPTER).html"

slides: chapters build/npm/.complete
	@python -m pypose_lite.teaching.site.assets build/npm
	@python -m pypose_lite.teaching.site.slides build/executed book/slides build/slides
	@cp -p build/npm/static/tex-svg-full.js build/npm/slides/* build/slides/static
	@printf '\nThe slides: file://%s\n' "$(CURDIR)/build/slides"

pdf: site
	@python -m pypose_lite.teaching.site.pdf $(HTML) build/book.pdf

picture: build/executed/index.ipynb
	python book/site/picture.py $< book/infinity.gif
	python -m pypose_lite.teaching.legged pypose_lite/teaching/legged/dog_on_infinity.jpg

lab: .venv/.installed
	@python -m pypose_lite.teaching.site.lab stage build/executed lab
	@python -m pypose_lite.teaching.site.lab start lab

reset: .venv/.installed
	@python -m pypose_lite.teaching.site.lab reset build/executed lab $(EXERCISE)

bench: .venv/.installed-bench
	@mkdir -p build
	pytest $(wildcard tests/bench/bench_*.py) -q --benchmark-group-by=group --benchmark-max-time=2 \
		--benchmark-timer=time.process_time --benchmark-columns=min,median,rounds --benchmark-sort=fullname \
		--benchmark-json=build/bench.json
	python book/site/benchmarks.py build/bench.json book/benchmarks.md
	python -m pypose_lite.teaching.batches

other-tools: .venv/.installed
	python -m pypose_lite.teaching.other_tools

.venv/.installed-bench .venv/.installed-grading: .venv/.installed
	@.ci/install $(PYTHON) $(subst .venv/.installed-,,$@)

install: .venv/.installed

wheel:
	test -z "$(TAG)" || grep -q "^__version__ = \"$(TAG:v%=%)\"$$" pypose_lite/__init__.py
	$(PYTHON) -m pip wheel --no-deps --wheel-dir dist .

# The library's tests, with the Python that is there: also on systems where .venv/bin is not.
library:
	$(PYTHON) -m pip install -c constraints.txt -e '.[test]'
	$(PYTHON) -m pytest tests -q -m "not wall_clock" $(addprefix --ignore=tests/,book teaching exercises)

# The claims of this checkout beside those of BASE, as a table; only the table is printed.
claims: .venv/.installed
	@git worktree add --force --detach build/base $(BASE) >&2
	@cd build/base && PYTHONPATH=$$PWD CLAIMS=$$PWD/build/claims pytest book $(wildcard solutions) -q -n 2 \
		--dist loadfile >&2 || true
	@git worktree list >&2
	@python -m pypose_lite.teaching.site.scoreboard --changes build/base/build/claims build/claims
	@git worktree remove --force build/base

# All checks with the newest of everything (WHAT=all), or of torch alone (WHAT=torch).
WHAT ?= all
newest:
	$(PYTHON) -m venv --clear .venv.newest
	@mkdir -p build
	if [ $(WHAT) = torch ]; then grep -v '^torch==' constraints.txt; fi > build/newest.txt
	.venv.newest/bin/python -m pip install --quiet -c build/newest.txt -e '.[book,test]'
	PATH=$(CURDIR)/.venv.newest/bin:$$PATH; pytest book $(wildcard solutions) -q -n 2 --dist loadfile && \
		pytest tests -q -n 2 --dist loadfile -m "not wall_clock"

NPM := --prefer-offline --ignore-scripts --no-audit --no-fund --loglevel=error \
  --fetch-retries=1 --fetch-retry-mintimeout=1000 --fetch-timeout=30000
workflows: .venv/.installed
	@mkdir -p build/workflows && cp .ci/workflows/* build/workflows
	@cd build/workflows && { test -d node_modules || npm ci $(NPM) 2> npm.log || \
		{ echo "pypose_lite: the linter cannot be fetched, see build/workflows/npm.log" >&2; exit 1; }; }
	@node build/workflows/lint.mjs .github/workflows/*.yml

clean:
	rm -rf build
