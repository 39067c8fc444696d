#!/usr/bin/env bash
# Makes the Python environment that a test compares against, once, and prints its path.
# Usage: scripts/test-venv.sh NAME PACKAGE...    e.g. scripts/test-venv.sh pinocchio pin
set -euo pipefail

name=$1
shift
target=${CARGO_TARGET_DIR:-$(cd "$(dirname "$0")/.." && pwd)/target}
venv=$target/venv-$name
mkdir -p "$target"

# Tests run side by side: the first one makes it, the others wait.
exec 9>"$venv.lock"
flock 9
if [[ "$(cat "$venv/.packages" 2>/dev/null)" != "$*" ]]; then
  rm -rf "$venv"
  "${PYTHON:-python3}" -m venv "$venv" >&2
  if ! "$venv/bin/pip" install --quiet --disable-pip-version-check "$@" >&2; then
    echo "cannot install '$*' with pip: can the package registry (PyPI) be reached?" >&2
    exit 1
  fi
  echo -n "$*" > "$venv/.packages"
fi
echo "$venv"
