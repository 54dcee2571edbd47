#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# A consumer that has the sources below its own.
set -euo pipefail
out=$WORK/add_subdirectory
rm -rf "$out"

# A copy of what a subproject needs, built in build/ at the same depth below the sources as the previous build, so that
# ccache already knows nearly every file. Without ccache the library is compiled a second time.
mkdir -p "$out/sources"
tar -C "$SOURCE" -cf - CMakeLists.txt cmake include nanovdb_kernels src tests/package/subproject tests/package/consumer |
  tar -C "$out/sources" -xf -
build=$out/sources/build/consumer
export CCACHE_BASEDIR=$out/sources
"$CMAKE" -G "$GENERATOR" -S "$out/sources/tests/package/subproject" -B "$build" "-DACCESSVDB_SOURCE=$out/sources" \
  "-DCMAKE_BUILD_TYPE=$BUILD_TYPE" "-DCMAKE_CXX_COMPILER=$CXX" "-DCMAKE_CXX_COMPILER_LAUNCHER=$LAUNCHER" \
  "-DACCESSVDB_WARNINGS_AS_ERRORS=${WARNINGS_AS_ERRORS:-OFF}" "-DACCESSVDB_UNITY=${UNITY:-OFF}" -DACCESSVDB_CUDA=OFF
"$CMAKE" --build "$build" -j 2 --target consumer
"$build/consumer" "$build/field"

# What a library must not do to the surrounding project: install its own files, set a build type, add tests.
"$CMAKE" --install "$build" --prefix "$build/installed" >/dev/null
[[ ! -e $build/installed/include/accessvdb ]] || { echo "the subproject installs itself"; exit 1; }
