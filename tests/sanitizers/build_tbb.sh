#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Builds oneTBB with the thread sanitizer, for the preset tsan: without it every task that another thread takes over
# looks like a race, and a suppression wide enough to hide these would hide our own.
#   apt-get source onetbb && tests/sanitizers/build_tbb.sh onetbb-2021.8.0
# Any source of oneTBB 2021.8 or later does. The library goes to build/tsan/tbb, where `ctest --preset tsan` looks.
set -euo pipefail
source=$(cd "${1:?usage: build_tbb.sh SOURCE_OF_ONETBB}" && pwd)
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
work=$PWD/build/tsan/tbb_build
cmake -S "$source" -B "$work" -G Ninja -DCMAKE_BUILD_TYPE=RelWithDebInfo -DCMAKE_CXX_FLAGS_RELWITHDEBINFO="-O1 -g1 -DNDEBUG" \
  -DTBB_SANITIZE=thread -DTBB_TEST=OFF -DTBB_STRICT=OFF -DTBBMALLOC_BUILD=OFF -DTBB_DISABLE_HWLOC_AUTOMATIC_SEARCH=ON
cmake --build "$work" -j "$(nproc)" --target tbb
mkdir -p build/tsan/tbb
cp -a "$(dirname "$(find "$work" -name 'libtbb.so.12' | head -1)")"/libtbb.so* build/tsan/tbb/
ls -l build/tsan/tbb
