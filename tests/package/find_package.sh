#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# A consumer with find_package: find_package.sh static|shared [PREFIX]
set -euo pipefail
kind=$1
prefix=${2:-$WORK/moved}
build=$WORK/find_package_$kind$([[ -z ${2:-} ]] || echo _of_archive)
rm -rf "$build"
options=()
if [[ $kind == shared ]]; then  # the library's private dependencies must not be required
  for package in assimp PNG OpenSSL; do options+=("-DCMAKE_DISABLE_FIND_PACKAGE_$package=ON"); done
fi
"$CMAKE" -G "$GENERATOR" -S "$SOURCE/tests/package/consumer" -B "$build" "-DCMAKE_PREFIX_PATH=$prefix" \
  "-DCMAKE_BUILD_TYPE=$BUILD_TYPE" "-DCMAKE_CXX_COMPILER=$CXX" "-DCMAKE_CXX_COMPILER_LAUNCHER=$LAUNCHER" \
  "-DKIND=$kind" "${options[@]}"
"$CMAKE" --build "$build"
"$build/consumer" "$build/field"
[[ -s $build/field/points.ply ]]

needed=$(readelf -d "$build/consumer" | sed -n 's/.*NEEDED.*\[\(.*\)\]/\1/p')
linked=static
if grep -q '^libaccessvdb\.so' <<<"$needed"; then linked=shared; fi
[[ $linked == "$kind" ]] || { echo "asked for $kind, linked $linked"; exit 1; }
