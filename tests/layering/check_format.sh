#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Checks that clang-format would change no C++ file. Versions differ in details: Debian 12's is the reference.
set -euo pipefail
cd "${1:-$(dirname "${BASH_SOURCE[0]}")/../..}"
version=$(clang-format --version 2>/dev/null | sed -nE 's/.*version ([0-9]+).*/\1/p' || true)
if [[ $version != 14 ]]; then
  echo "skipped: needs clang-format 14, found ${version:-none}"
  exit 77
fi

folders=()
for folder in include nanovdb_kernels src tools examples python tests; do
  [[ -d $folder ]] && folders+=("$folder")
done
mapfile -d '' -t files < <(find "${folders[@]}" -type f \( -name '*.h' -o -name '*.cuh' -o -name '*.cpp' -o -name '*.cu' \) -print0)
((${#files[@]} > 0)) || { echo "no files found"; exit 1; }
unformatted=$(printf '%s\0' "${files[@]}" | xargs -0 clang-format --dry-run 2>&1 |
  sed -nE 's/^([^:]+):[0-9]+:[0-9]+: warning:.*clang-format-violations.*/\1/p' | sort -u)
if [[ -n $unformatted ]]; then
  echo "$unformatted"
  echo "Run: clang-format -i FILE"
  exit 1
fi
