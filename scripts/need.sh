#!/usr/bin/env bash
# Installs missing commands from Debian's packages, on Debian and as root; otherwise names what is missing.
# Usage: need.sh COMMAND=PACKAGE...    such as: need.sh ip=iproute2 cmake=cmake
set -euo pipefail

packages=()
for pair in "$@"; do
  command -v "${pair%%=*}" >/dev/null || packages+=("${pair#*=}")
done
((${#packages[@]} == 0)) && exit 0

if [[ $(id -u) != 0 ]] || ! command -v apt-get >/dev/null; then
  echo "need.sh: not installed: ${packages[*]}; please install (on Debian: apt-get install ${packages[*]})" >&2
  exit 3
fi
echo "need.sh: installing ${packages[*]}" >&2
export DEBIAN_FRONTEND=noninteractive
install() { apt-get install --yes --quiet --no-install-recommends "${packages[@]}" >&2 </dev/null; }
# The package lists of a fresh machine are empty or old.
install || { apt-get update --quiet >&2 && install; } || {
  echo "need.sh: apt-get could not install ${packages[*]}; is the package registry reachable?" >&2
  exit 3
}
