#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The example label_a_scan: with the generated scan, and with the same scan read from a file.
set -euo pipefail
out=$WORK/label_a_scan
rm -rf "$out"
mkdir -p "$out"
"$LABEL_A_SCAN" | tee "$out/generated.txt"
grep -qE '^accessible [1-9]' "$out/generated.txt"

"$MAKE_SAMPLE_SCANS" --out "$out/scans" --frames 1 >/dev/null
read -r _ x y z qx qy qz qw < <(grep -v '^#' "$out/scans/poses.txt")
"$LABEL_A_SCAN" "$out/scans/000000.pcd" "$x" "$y" "$z" "$qx" "$qy" "$qz" "$qw" | tee "$out/file.txt"
grep -qE '^accessible [1-9]' "$out/file.txt"

code=0
"$LABEL_A_SCAN" "$out/scans/000000.pcd" 0 0 0 nan 0 0 1 2>"$out/stderr" || code=$?
[[ $code == 2 ]] && grep -q "not a finite number" "$out/stderr"
code=0
"$LABEL_A_SCAN" "$out/none.pcd" 0 0 0 0 0 0 1 2>"$out/stderr" || code=$?
[[ $code == 3 ]]
