#!/usr/bin/env bash
# Makes a Python environment for the tests from PyPI, once, and prints the path of its interpreter.
# Usage: test-venv.sh                    a real ROS 2 Jazzy (rclpy on Fast DDS) and readers of bags
#        test-venv.sh NAME PACKAGE...    a separate environment, such as: test-venv.sh pinocchio pin
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
dir=${CARGO_TARGET_DIR:-$root/target}/venv${1:+-$1}
wheels_of_ros=false
if (($# > 0)); then
  shift
  packages=("$@")
else
  wheels_of_ros=true
  packages=(
    ros-jazzy-{rclpy,rmw-fastrtps-cpp,rmw-dds-common,fastrtps}
    ros-jazzy-{std,sensor,geometry,nav,diagnostic,trajectory,visualization,rosgraph,test}-msgs
    ros-jazzy-std-srvs ros-jazzy-rcl-interfaces
    rosbags mcap-ros2-support
  )
fi
stamp="$dir/.made-of-$(printf '%s\n' "${packages[@]}" | cksum | cut -d' ' -f1)"

mkdir -p "$(dirname "$dir")"
# Tests run in parallel; the first one makes the environment, the others wait.
exec 9>"$dir.lock"
flock 9
if [[ ! -e $stamp ]]; then
  "$root/scripts/need.sh" python3=python3
  python=${PYTHON:-$(command -v python3.11 || command -v python3)}
  version=$("$python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  if $wheels_of_ros && [[ $version != 3.11 ]]; then
    echo "test-venv.sh: $python is $version; the ROS wheels need Python 3.11 (python3.11 on PATH)" >&2
    exit 3
  fi
  # Debian's Python leaves this part of the standard library out.
  "$python" -c 'import ensurepip' 2>/dev/null || "$root/scripts/need.sh" "python$version-venv=python$version-venv"
  rm -rf "$dir"
  "$python" -m venv "$dir" >&2
  "$dir/bin/pip" install --quiet --disable-pip-version-check "${packages[@]}" >&2 || {
    rm -rf "$dir"
    echo "test-venv.sh: pip could not install ${packages[*]}; is the package registry reachable?" >&2
    exit 3
  }
  touch "$stamp"
fi
echo "$dir/bin/python"
