#!/usr/bin/env bash
# Builds what `cargo bench --bench peers` compares with: Pinocchio and MuJoCo from PyPI, each behind a small
# program compiled for this machine. Everything goes to target/; some minutes and 2 GB of memory once.
set -euo pipefail

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
sources=$root/benches/peers
out=${CARGO_TARGET_DIR:-$root/target}/peers

"$root/scripts/need.sh" g++=g++
compilers=()
# The newest clang at hand; Debian's of today if there is none.
clang=$(compgen -c clang++ | grep -xE 'clang\+\+(-[0-9]+)?' | sort -t- -k2 -n | tail -1 || true)
if [[ -z $clang ]] && "$root/scripts/need.sh" clang++-19=clang-19; then clang=clang++-19; fi
if [[ -n $clang ]]; then compilers+=("$clang"); fi
compilers+=(g++)

python=$("$root/scripts/test-venv.sh" peers pin==4.1.0 mujoco==4.0.0 cmeel-eigen==3.4.1)
packages=$("$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
prefix=$packages/cmeel.prefix
mujoco=$(find "$packages/mujoco" -maxdepth 1 -name 'libmujoco.so.*')
# Those that Pinocchio's own CMake targets ask for.
pinocchio=(
  -DBOOST_MPL_LIMIT_LIST_SIZE=30 -DBOOST_MPL_LIMIT_VECTOR_SIZE=30
  -DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS -DBOOST_FUSION_INVOKE_MAX_ARITY=12
  -I "$out/include" -isystem "$prefix/include" -isystem "$prefix/include/eigen3"
)

mkdir -p "$out"
exec 9>"$out.lock"
flock 9
# Pinocchio's Data takes nv^3 numbers four times for second derivatives, which nothing here asks for: 32 GB for
# a chain of 1000 links. This copy of one header takes none.
data=pinocchio/src/multibody/data.hxx
mkdir -p "$out/include/${data%/*}"
sed -E 's/(d2tau_[a-z]+|kinematic_hessians)\((6|model\.nv), model\.nv, model\.nv\)/\1(0, 0, 0)/' \
  "$prefix/include/$data" >"$out/include/$data"

# Compiles NAME with COMPILER and FLAGS..., unless it is newer than its sources.
build() {
  local program=$out/$1
  shift
  [[ -x $program && $program -nt $sources/peer.hpp && $program -nt $sources/pinocchio.cpp &&
    $program -nt $sources/mujoco.cpp && $program -nt ${BASH_SOURCE[0]} ]] && return
  echo "bench-peers.sh: compiling $program" >&2
  nice "$1" -std=c++17 -w -DNDEBUG "${@:2}" -o "$program"
}

for compiler in "${compilers[@]}"; do
  name=${compiler%%+*}
  name=${name/#g/gcc}
  build "pinocchio-$name" "$compiler" -O3 -march=native "${pinocchio[@]}" "$sources/pinocchio.cpp"
done
# The reference for precision.
build pinocchio-long-double "${compilers[0]}" -O0 '-DSCALAR=long double' "${pinocchio[@]}" "$sources/pinocchio.cpp"
# MuJoCo's library comes compiled; only the calls are ours.
build mujoco "${compilers[0]}" -O3 -march=native -isystem "$packages/mujoco/include" \
  "$sources/mujoco.cpp" "$mujoco" "-Wl,-rpath,$packages/mujoco"
ls "$out" >&2
