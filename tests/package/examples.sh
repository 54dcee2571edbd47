#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The examples stream, own_tool and own_kernel: examples.sh stream|own_tool|own_kernel
set -euo pipefail
out=$WORK/example_$1
rm -rf "$out"
mkdir -p "$out"

expect() {  # CODE TEXT COMMAND...
  local code=0
  "${@:3}" >"$out/stdout" 2>"$out/stderr" || code=$?
  [[ $code == "$1" ]] && grep -q "$2" "$out/stderr" || { echo "code $code, expected $1 and '$2': $(<"$out/stderr")"; exit 1; }
}

case $1 in
stream)
  "$STREAM_SCANS" 6 | tee "$out/stdout"
  [[ $(grep -cE '^frame [0-5]: [0-9]+ reachable' "$out/stdout") == 6 ]]
  grep -qE '^frame 5: [1-9][0-9]* reachable, [1-9][0-9]* new' "$out/stdout"
  grep -qE 'way to the nearest: (free|blocked|not all seen)$' "$out/stdout"
  expect 2 "number of frames" "$STREAM_SCANS" 0
  ;;
own_tool)
  "$OWN_TOOL" | tee "$out/stdout"
  grep -q 'tool gripper: 0.250 x 0.120 x 0.060 m' "$out/stdout"
  grep -qE '^accessible [1-9]' "$out/stdout"
  # A 200 mm rod along y, tip at y = 10, as an OBJ in millimetres.
  {
    for y in 10 210; do for x in -5 5; do for z in -5 5; do echo "v $x $y $z"; done; done; done
    printf 'f %s\n' "1 2 4 3" "5 7 8 6" "1 5 6 2" "3 4 8 7" "1 3 7 5" "2 6 8 4"
  } >"$out/rod.obj"
  "$OWN_TOOL" "$out/rod.obj" mm 0 10 0 0 1 0 | tee "$out/stdout"
  grep -q '0.200 x 0.010 x 0.010 m, reaches 0.200 m' "$out/stdout"
  grep -qE '^accessible [1-9]' "$out/stdout"
  expect 2 "not a unit" "$OWN_TOOL" "$out/rod.obj" parsec 0 10 0 0 1 0
  expect 3 none.obj "$OWN_TOOL" "$out/none.obj" mm 0 10 0 0 1 0
  ;;
own_kernel)
  code=0
  "$OWN_KERNEL" >"$out/stdout" 2>"$out/stderr" || code=$?
  cat "$out/stdout" "$out/stderr"
  if [[ $code == 6 && -z ${ACCESSVDB_REQUIRE_GPU:-} ]]; then
    echo "skipped: no GPU to run the kernel on; it was compiled"
    exit 77
  fi
  [[ $code == 0 ]] && grep -qE 'wrist free [1-9]' "$out/stdout"
  ;;
esac
