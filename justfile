# Recipes for daily work (https://just.systems). CI runs the steps of .ci/run.

# list the recipes
default:
    @just --list --unsorted

# launch a scenario, by default config/capture.yaml: a capture, with a bag in bags/
run *ARGS:
    cargo run --release -- launch {{ARGS}}

# simulate a scenario without DDS
simulate CONFIG="config/positioning.yaml" *ARGS:
    cargo run --release -- simulate {{CONFIG}} {{ARGS}}

# every test, or those whose name contains a word
test *ARGS:
    cargo test --release {{ARGS}}

# the same with the profile for daily work: an edit rebuilds only what it changed
quick *ARGS:
    cargo test --profile quick {{ARGS}}

# the benchmarks in benches/
bench *ARGS:
    cargo bench {{ARGS}}

# an hour of joint states at 1 kHz with a bag, or as many seconds as given
soak *SECONDS:
    scripts/soak.sh {{SECONDS}}

# build the operator's page, which `fuyu launch --cockpit` serves; needs Node.js 20.19 or later
cockpit:
    cd cockpit && npm ci --no-audit --no-fund && npm run build

# format the sources
format:
    cargo fmt --all

# one or more steps of CI: fmt, lint, doc, msrv, test, slow, fuzz, cockpit, colcon, embed, python, zenoh
step +STEPS:
    .ci/run {{STEPS}}

# are the sources formatted?
fmt: (step "fmt")

# clippy, with and without ROS
lint: (step "lint")

# the documentation, without a warning
doc: (step "doc")

# compile with the oldest Rust that is supported
msrv: (step "msrv")

# the tests that take ten seconds to minutes each
slow: (step "slow")

# mutated inputs for so many seconds: bags, URDF, YAML, CSV, message definitions, CDR
fuzz SECONDS="120":
    FUYU_FUZZ_SECONDS={{SECONDS}} cargo test --release --test fuzz -- --nocapture --test-threads 1

# both packages as a colcon workspace builds them
colcon: (step "colcon")

# the wheel of the Python package, and its tests
python: (step "python")

# all steps of CI
ci:
    .ci/run
