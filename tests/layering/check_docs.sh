#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Every file and folder that the documents name is there: link targets, and paths in backticks that begin with a folder
# of the repository. check_docs.sh [ROOT]
set -euo pipefail
cd "${1:-$(dirname "${BASH_SOURCE[0]}")/../..}"

missing=0
shopt -s nullglob
for document in ./*.md docs/*.md; do
  while read -r from target; do
    [[ -e $from/$target ]] || { echo "$document: '$target' does not exist"; missing=1; }
  done < <(
    grep -oE '\]\([^)#]+' "$document" | sed 's/^](//' | grep -vE '^[a-z]+:' | sed "s|^|$(dirname "$document") |" || true
    grep -oE '`(\./)?(include|src|nanovdb_kernels|tools|tests|examples|docs|cmake)/[A-Za-z0-9_./-]+[A-Za-z0-9_]' "$document" |
      sed 's/^`/. /' || true
  )
done
exit $missing
