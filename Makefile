.PHONY: serve test coverage check check-native push-basin g1-tour terrains chaos orphans fuzz mutants bench docs lock load soak

# Where the environment forbids to keep compiled modules, every process compiles all libraries anew: 7.8 s of imports for a plan, not 2.4.
unexport PYTHONDONTWRITEBYTECODE

serve:  ## start everything on http://127.0.0.1:8000
	@scripts/serve

test:  ## run the whole test suite
	@scripts/test

check:  ## lint, format, types, compose files, the book
	@scripts/check

check-native:  ## the C++ solver: format, lint, unit tests under sanitizers
	@scripts/check-native

fuzz:  ## mutated files for the readers, ten minutes each
	@scripts/fuzz

coverage:  ## lines of the numeric packages that their tests run; at least 90 %
	@scripts/coverage

mutants:  ## changes of the numeric code that its tests do not notice (ARGS="--sample 300 contacts")
	@scripts/mutants $(ARGS)

bench:  ## run the benchmarks and write docs/benchmarks.md
	@scripts/bench

chaos:  ## many jobs under random kills (ARGS="--jobs 500 --kills 10")
	@scripts/chaos $(ARGS)

orphans:  ## how long the job of a killed worker waits for another one (ARGS=kills)
	@scripts/orphans $(ARGS)

push-basin:  ## which pushes a walking robot survives in physics (ARGS="long-stride --speed 0.2 --pushes 50")
	@scripts/push-basin $(ARGS)

g1-tour:  ## the tour of a public benchmark of G1, steered, punched (ARGS="--runs 8 --first 0")
	@scripts/g1-tour $(ARGS)

terrains:  ## random terrains for three robots, planned, certified, replayed; writes docs/theory/terrains.md (ARGS="--seed 7 --number 60")
	@scripts/terrains $(ARGS)

load:  ## 200 clients while both cores solve (ARGS="--clients 50 --seconds 30")
	@scripts/load $(ARGS)

soak:  ## half an hour of work, watching what grows (ARGS="--minutes 10")
	@scripts/soak $(ARGS)

docs:  ## build the book into site/
	@scripts/docs

lock:  ## renew the hashed locks from pyproject.toml
	@scripts/lock
