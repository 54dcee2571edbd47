#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Configures one preset of CMakePresets.json and builds all of it or some targets, with ccache and mold if they work, on
# as many jobs as memory allows. Arguments that begin with -D go to CMake, the others are targets:
#   build_preset.sh ci        build_preset.sh release -DACCESSVDB_CUDA=OFF accessvdb_cli
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
preset=${1:?usage: build_preset.sh PRESET [-DNAME=VALUE...] [TARGET...]}
shift
settings=() targets=()
for argument in "$@"; do
  if [[ $argument == -D* ]]; then settings+=("$argument"); else targets+=("$argument"); fi
done

# Translation units with OpenVDB take up to 2 GB each.
memory_kb=$(awk '/^MemAvailable:/ {print $2}' /proc/meminfo)
if [[ -r /sys/fs/cgroup/memory.max ]]; then
  limit=$(cat /sys/fs/cgroup/memory.max)
  if [[ $limit != max ]] && ((limit / 1024 < memory_kb)); then memory_kb=$((limit / 1024)); fi
fi
jobs=$((memory_kb / (2 * 1024 * 1024)))
((jobs >= 1)) || jobs=1
((jobs <= $(nproc))) || jobs=$(nproc)

# Also passes empty values, so that a launcher that no longer exists does not stay in the cache.
launcher=$(command -v ccache || true)
linker=""
if command -v mold >/dev/null && echo 'int main() {}' | c++ -fuse-ld=mold -x c++ - -o /dev/null 2>/dev/null; then
  linker=-fuse-ld=mold
fi
export CCACHE_BASEDIR=$PWD

cmake --preset "$preset" "-DCMAKE_CXX_COMPILER_LAUNCHER=$launcher" "-DCMAKE_CUDA_COMPILER_LAUNCHER=$launcher" \
  "-DCMAKE_EXE_LINKER_FLAGS=$linker" "-DCMAKE_SHARED_LINKER_FLAGS=$linker" \
  ${settings[@]+"${settings[@]}"}
cmake --build --preset "$preset" -j "$jobs" ${targets[@]+--target "${targets[@]}"}
