#!/usr/bin/env bash
# Soak test: an hour of joint states at 1 kHz with a bag; checks memory, lost messages and time. Usage: soak.sh [SECONDS]
set -euo pipefail

cd "$(dirname "${BASH_SOURCE[0]}")/.."
FUYU_SOAK_SECONDS=${1:-3600} cargo test --locked --release --test interop soak -- --nocapture
