#!/usr/bin/env bash
# Makes the Python environment that tests read bags with, once, and prints the path of its interpreter.
set -euo pipefail
root=$(cd "$(dirname "$0")/.." && pwd)
venv=${FUYU_TEST_VENV:-$root/target/venv}
mkdir -p "$(dirname "$venv")"
exec 9>"$venv.lock"
flock 9
if [[ ! -e $venv/.complete ]]; then
  {
    python3.11 -m venv "$venv" 2>/dev/null || python3 -m venv "$venv"
    "$venv/bin/pip" install -q rosbags mcap-ros2-support ros-jazzy-rclpy \
      ros-jazzy-{std,sensor,geometry,nav,diagnostic,rosgraph}-msgs ros-jazzy-std-srvs \
      || { echo "test-venv.sh: pip cannot install the ROS 2 wheels from PyPI; is the network there?"; exit 1; }
    touch "$venv/.complete"
  } >&2
fi
echo "$venv/bin/python"
