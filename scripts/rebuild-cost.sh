#!/usr/bin/env bash
# What an edit in each library costs to rebuild the executable `fuyu`: processor time and time, with the profiles release and quick.
# The edit is a statement more in a function; all are removed at the end. `clean` is a build from nothing, in a folder of its own.
#   scripts/rebuild-cost.sh [release|quick|clean]...
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

edited=(
  crates/fuyu-physics/src/dynamics/workspace.rs
  crates/fuyu-physics/src/estimation/tracks.rs
  crates/fuyu-ros/src/ros/publisher.rs
  src/nodes/controller/mod.rs
  src/experiments/capturing.rs
  src/main.rs
)

# Seconds of processor time and of time of a command.
cost() {
  local TIMEFORMAT='%U %S %R'
  { time "$@" >/dev/null 2>&1; } 2>&1 | awk '{printf "%.0f s | %.0f s", $1 + $2, $3}'
}

# Adds a statement to the first function of a file whose signature is on one line.
edit() { sed -i '0,/^ *\(pub\(([a-z]*)\)\? \)\?fn [^;]*{$/ s//&\n    std::hint::black_box(0u8);/' "$1"; }

restore() { for file in "${edited[@]}"; do git checkout --quiet "$file"; done; }

if ! git diff --quiet -- "${edited[@]}"; then
  echo "rebuild-cost.sh: commit or stash the changes of ${edited[*]} first: they are edited and restored" >&2
  exit 2
fi
trap restore EXIT
echo "| profile | edit in | processor time | time |"
echo "| --- | --- | ---: | ---: |"
for profile in "${@:-release quick clean}"; do
  for profile in $profile; do
    if [[ $profile == clean ]]; then
      folder=$(mktemp -d)
      echo "| release | everything | $(CARGO_TARGET_DIR=$folder cost cargo build --locked --release --bin fuyu) |"
      rm -rf "$folder"
      continue
    fi
    cargo build --quiet --locked --profile "$profile" --bin fuyu
    for file in "${edited[@]}"; do
      edit "$file"
      if git diff --quiet -- "$file"; then
        echo "rebuild-cost.sh: $file has no function to edit" >&2
        exit 1
      fi
      echo "| $profile | $file | $(cost cargo build --locked --profile "$profile" --bin fuyu) |"
    done
    restore
  done
done
