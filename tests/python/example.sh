#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The notebook-style example: as is, and with scans from files, for which its counts equal the program's.
set -euo pipefail
example=$SOURCE/examples/python/map_a_corner.py
out=$WORK/example
rm -rf "$out"
mkdir -p "$out"

"$PYTHON" -W error "$example" --out "$out/corner" | tee "$out/corner.txt"
grep -qE '^  accessible +[1-9][0-9]{2,}' "$out/corner.txt"
grep -qE '^  blocked +[1-9][0-9]' "$out/corner.txt"
grep -q '^arm 0: free$' "$out/corner.txt"
grep -q '^arm 1: collides$' "$out/corner.txt"
grep -q '^arm 2: not known$' "$out/corner.txt"
for file in labels.png field.vdb field_points.vdb points.ply; do [[ -s $out/corner/$file ]] || { echo "no $file"; exit 1; }; done
[[ $(head -c 8 "$out/corner/labels.png" | od -An -tx1 | tr -d ' \n') == 89504e470d0a1a0a ]] || { echo "no picture"; exit 1; }

"$MAKE_SAMPLE_SCANS" --out "$out/scans" --frames 4 --rays 6000 --seed 3 >/dev/null
"$PYTHON" -W error "$example" --scans "$out/scans" --poses "$out/scans/poses.txt" --tool builtin:pruner --voxel 0.1 \
  --out "$out/files" | tee "$out/files.txt"
"$PROGRAM" map --scans "$out/scans" --poses "$out/scans/poses.txt" --tool builtin:pruner --voxel 0.1 --range-noise 0.02 \
  --quiet --out "$out/program"
rows() { LC_ALL=C sed '1,/^end_header$/d' "$1"; }
cmp <(rows "$out/files/points.ply") <(rows "$out/program/points.ply")

# The one of a flight: its second run goes on, and both together have the labels of one run.
fly() { "$PYTHON" -W error "$SOURCE/examples/python/rolling.py" --memory-mb "$3" --folder "$out/$1" --metres "$2" --out "$out/$1$2"; }
fly flight 20 150 | grep -x 'begins'
fly flight 40 150 | tee "$out/flight.txt"
grep -qx 'goes on after scan 40' "$out/flight.txt"
fly whole 40 4000 | tee "$out/whole.txt"
grep -qE "'accessible': [1-9][0-9]{4}" "$out/whole.txt"
cmp <(grep '^{' "$out/flight.txt") <(grep '^{' "$out/whole.txt")
