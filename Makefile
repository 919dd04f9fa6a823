# make book    the book as a site, from executed chapters, and the scoreboard of its claims
# make test    everything that CI checks
# make lab     the chapters in JupyterLab
# make exercises            the exercises, from their solutions
# make page CHAPTER=03_mpc   one chapter alone, run and built, to look at
# make picture               the README's picture, from the opening page
# make bench   speed beside other libraries, as ratios: makes the book's page of them anew
# make clean   removes what these made, .venv excepted

SHELL := /bin/sh
.DELETE_ON_ERROR:
.PHONY: book test lab exercises page picture bench clean lint chapters site

PYTHON ?= python3
BIN := .venv/bin
export OMP_NUM_THREADS ?= 1
export PATH := $(CURDIR)/$(BIN):$(PATH)

LIBRARY := $(shell find pypose_lite -name '*.py')
PAGES := $(shell sed -nE 's/.*(root|file): //p' _toc.yml)
NOTEBOOKS := $(foreach page,$(PAGES),$(if $(wildcard book/$(page).py),build/executed/$(page).ipynb))
SITE := build/site/_build/html/index.html
JUPYTER_BOOK := jupyter-book build -q

book: site
	@python book/site/scoreboard.py build/executed
	@printf '\nThe book: file://%s\n' "$(CURDIR)/$(SITE)"

test: lint site
	pytest book $(wildcard solutions) -q -n 2 --dist loadfile
	python book/site/scoreboard.py build/executed build/claims
	pytest tests -q -n 2 --dist loadfile -m "not wall_clock"
	pytest tests/go1 -q -m wall_clock --reruns 9 --reruns-delay 10 --only-rerun Busy

lint: .venv/.installed
	ruff check
	ruff format --check
	mypy

site: chapters build/npm/.complete
	python book/site/stage.py build/executed build/book
	cp -Rp build/npm/static build/npm/extra build/book
	$(JUPYTER_BOOK) build/book --path-output build/site -W -n --keep-going

# Chapters run side by side, one process for each of two cores; each is run again only when it or
# the library has changed.
chapters: .venv/.installed
	@rm -f $(filter-out $(NOTEBOOKS),$(wildcard build/executed/*.ipynb))
	@$(MAKE) -s -j2 $(NOTEBOOKS)

build/executed/%.ipynb: book/%.py book/site/execute.py $(LIBRARY) .venv/.installed
	@python book/site/execute.py $< $@

build/npm/.complete: book/site/assets.sh .venv/.installed
	@$< build/npm && touch $@

.venv/.installed: pyproject.toml constraints.txt requirements-vendor.txt .ci/install
	@.ci/install $(PYTHON)

exercises: .venv/.installed
	@python book/site/make_exercises.py solutions exercises

page: build/executed/$(CHAPTER).ipynb build/npm/.complete
	python book/site/stage.py build/executed build/page $(CHAPTER)
	printf 'format: jb-book\nroot: $(CHAPTER)\n' > build/page/_toc.yml
	cp -Rp build/npm/static build/npm/extra build/page
	$(JUPYTER_BOOK) build/page
	@printf '\nThe page: file://%s\n' "$(CURDIR)/build/page/_build/html/$(CHAPTER).html"

picture: build/executed/index.ipynb
	python book/site/picture.py $< book/infinity.gif

lab: .venv/.installed
	@JUPYTER_CONFIG_DIR=build/lab jupytext-config set-default-viewer python
	JUPYTER_CONFIG_DIR=build/lab jupyter lab --ip=127.0.0.1 --LabApp.news_url=None book

bench: .venv/.installed-bench
	@mkdir -p build
	pytest $(wildcard tests/bench/bench_*.py) -q --benchmark-group-by=group --benchmark-max-time=2 \
		--benchmark-columns=min,median,rounds --benchmark-sort=fullname \
		--benchmark-json=build/bench.json
	python book/site/benchmarks.py build/bench.json book/benchmarks.md

.venv/.installed-bench: .venv/.installed
	@.ci/install $(PYTHON) bench

clean:
	rm -rf build
