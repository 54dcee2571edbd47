#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The program runs on the plainest x86-64 processor, without AVX, SSE4 or POPCNT, and writes the same bytes there.
set -euo pipefail
qemu=$(command -v qemu-x86_64-static || command -v qemu-x86_64) || { echo "skipped: qemu-x86_64 (qemu-user-static) is missing"; exit 77; }
[[ $(uname -m) == x86_64 ]] || { echo "skipped: this is no x86-64"; exit 77; }
folder=$WORK/no_avx
rm -rf "$folder"
mkdir -p "$folder"
cd "$folder"
"$MAKE_SAMPLE_SCANS" --out scans --frames 2 --rays 2000 --range-noise 0.01 >/dev/null
job=(map --scans scans --poses scans/poses.txt --tool builtin:pruner --voxel 0.05 --device cpu --quiet)
"$PROGRAM" "${job[@]}" --out here
"$qemu" -cpu qemu64 "$PROGRAM" "${job[@]}" --out there
for file in points.ply preview.png; do
  cmp here/$file there/$file || { echo "$file differs without AVX"; exit 1; }
done
(($(wc -c <here/points.ply) > 10000)) || { echo "hardly any points"; exit 1; }
