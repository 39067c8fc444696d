#!/usr/bin/env bash
# Builds both ROS packages as a user's workspace does, with colcon and its cargo extension from PyPI, and checks that
# the install space is complete: executables, share, the ament index, messages that rclpy imports.
# fuyu itself is compiled in cargo's target folder, so what is already compiled there is reused.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
target=${CARGO_TARGET_DIR:-$root/target}
workspace=$target/colcon
python=$("$root/scripts/test-interfaces.sh")
ros=$(dirname "$(dirname "$python")")
colcon=$(dirname "$("$root/scripts/test-venv.sh" colcon \
  colcon-core==0.21.3 colcon-bash==0.5.0 colcon-cmake==0.2.30 colcon-ros==0.5.0 colcon-recursive-crawl==0.2.3 \
  colcon-python-setup-py==0.2.9 colcon-library-path==0.2.1 colcon-pkg-config==0.1.0 \
  colcon-cargo==0.2.0 colcon-ros-cargo==0.2.0 cargo-ament-build==0.1.11 setuptools==79.0.1)")

rm -rf "$workspace"
mkdir -p "$workspace"/{src,build}
ln -s "$root" "$workspace/src/fuyu"
ln -s "$target" "$workspace/build/fuyu"
cd "$workspace"
# The wheels of ROS are the underlay, instead of /opt/ros.
export AMENT_PREFIX_PATH=$ros CMAKE_PREFIX_PATH=$ros PATH=$colcon:$ros/bin:$PATH
build() {
  colcon --log-base log build "$@" >&2 || {
    tail -n 100 log/latest_build/*/stdout_stderr.log >&2
    echo "test-colcon.sh: colcon build $* failed, see above" >&2
    exit 1
  }
}
build --base-paths src/fuyu --packages-select fuyu --cargo-args --release --locked --features ros
build --base-paths src/fuyu/msg --cmake-args -DPython3_EXECUTABLE="$python" -DBUILD_TESTING=OFF

failed=0
there() {
  if [[ -e install/$1 ]]; then return; fi
  echo "test-colcon.sh: the install space has no $1" >&2
  failed=1
}
index=share/ament_index/resource_index
there "fuyu/$index/packages/fuyu"
there "fuyu_msgs/$index/packages/fuyu_msgs"
there "fuyu_msgs/$index/rosidl_interfaces/fuyu_msgs"
there fuyu/share/fuyu/package.xml
for executable in fuyu dynamics camera controller attitude estimator teleop recorder; do
  there "fuyu/lib/fuyu/$executable"
done
# Every file of the sources.
for file in $(cd "$root" && git ls-files -- config urdf launch); do there "fuyu/share/fuyu/$file"; done
for message in "$root"/msg/*.msg; do there "fuyu_msgs/share/fuyu_msgs/msg/$(basename "$message")"; done
((failed == 0))

# In another folder, in a shell that has only sourced the workspace.
set +u
source install/setup.bash
set -u
cd /
prefix=$workspace/install
ran=$("$prefix/fuyu/lib/fuyu/fuyu" simulate package://fuyu/config/positioning.yaml --duration 1 --json)
grep -q '"tip_position_error"' <<<"$ran"
"$python" - "$prefix" <<'PYTHON'
import sys
import fuyu_msgs.msg
from rclpy.serialization import deserialize_message, serialize_message

assert fuyu_msgs.__file__.startswith(sys.argv[1]), fuyu_msgs.__file__
before = fuyu_msgs.msg.Momentum(kinetic_energy=2.5)
assert deserialize_message(serialize_message(before), fuyu_msgs.msg.Momentum) == before
PYTHON
echo "test-colcon.sh: $(ls "$prefix/fuyu/lib/fuyu" | wc -l) executables, $(find "$prefix/fuyu/share/fuyu/"{config,urdf,launch} -type f | wc -l) files of share/fuyu, fuyu_msgs for rclpy"
