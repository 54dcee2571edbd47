#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Shows that check_flags.sh fires, on planted compile commands.
set -euo pipefail
checker=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/check_flags.sh
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
failures=0

expect() {  # expect EXIT_CODE FILE FLAGS: the second of two translation units has these flags
  local code=0
  cat >"$folder/commands.json" <<END
[
{
  "directory": "/b",
  "command": "/usr/bin/c++ -O3 -ffp-contract=off -o a.o -c /s/a.cpp",
  "file": "/s/a.cpp"
},
{
  "directory": "/b",
  "command": "/usr/bin/c++ $3 -o b.o -c $2",
  "file": "$2"
}
]
END
  "$checker" "$folder/commands.json" >"$folder/out" || code=$?
  if ((code != $1)) || { ((code == 1)) && ! grep -q "^$2: " "$folder/out"; }; then
    echo "FAILED: '$3' for $2: exit code $code instead of $1"
    failures=$((failures + 1))
  fi
}

expect 0 /s/b.cpp "-O3 -ffp-contract=off -Wall"
expect 1 /s/b.cpp "-O3 -Wall"
for flag in -Ofast -ffast-math -funsafe-math-optimizations -ffp-contract=fast; do
  expect 1 /s/b.cpp "-ffp-contract=off $flag"
done
cuda="--fmad=false -prec-div=true -prec-sqrt=true -ftz=false"
expect 0 /s/b.cu "-O3 $cuda"
for flag in $cuda; do
  expect 1 /s/b.cu "-O3 ${cuda/$flag/}"
done
for flag in --use_fast_math -use_fast_math --fmad=true -prec-div=false -prec-sqrt=false -ftz=true; do
  expect 1 /s/b.cu "$cuda $flag"
done

code=0
"$checker" "$folder/none.json" >/dev/null || code=$?
((code == 77)) || { echo "FAILED: a missing file gives exit code $code instead of 77"; failures=$((failures + 1)); }
echo "[]" >"$folder/empty.json"
code=0
"$checker" "$folder/empty.json" >/dev/null || code=$?
((code == 1)) || { echo "FAILED: an empty list gives exit code $code instead of 1"; failures=$((failures + 1)); }

((failures == 0)) || exit 1
echo "every rule fires"
