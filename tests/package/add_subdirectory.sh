#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# A consumer that has the sources below its own.
set -euo pipefail
build=$WORK/add_subdirectory
rm -rf "$build"
"$CMAKE" -G "$GENERATOR" -S "$SOURCE/tests/package/subproject" -B "$build" "-DACCESSVDB_SOURCE=$SOURCE" \
  "-DCMAKE_BUILD_TYPE=$BUILD_TYPE" "-DCMAKE_CXX_COMPILER=$CXX" "-DCMAKE_CXX_COMPILER_LAUNCHER=$LAUNCHER" \
  "-DACCESSVDB_WARNINGS_AS_ERRORS=${WARNINGS_AS_ERRORS:-OFF}" -DACCESSVDB_CUDA=OFF
"$CMAKE" --build "$build" -j 2 --target consumer
"$build/consumer" "$build/field"

# What a library must not do to the project around it: install its own files, set a build type, add tests.
"$CMAKE" --install "$build" --prefix "$build/installed" >/dev/null
[[ ! -e $build/installed/include/accessvdb ]] || { echo "the subproject installs itself"; exit 1; }
