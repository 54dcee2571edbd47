#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The plug-in in C: compiled against the installed header alone, it loads the installed library at run time and produces
# the same points as the program, byte for byte.
set -euo pipefail
out=$WORK/c_plugin
rm -rf "$out"
mkdir -p "$out"
"$CC" -std=gnu99 -O1 -Wall -Wextra -Werror "-I$WORK/moved/include" "-I$SOURCE/examples" \
  "$SOURCE/examples/c_plugin/map_scans.c" "$SOURCE/examples/c_plugin/scan_files.c" -o "$out/plugin" -ldl -lm
! readelf -d "$out/plugin" | grep -q accessvdb || { echo "the plug-in is linked with the library"; exit 1; }

"$MAKE_SAMPLE_SCANS" --out "$out/scans" --frames 6 --rays 8000 --seed 3 >/dev/null
"$out/plugin" "$WORK/moved/$LIBDIR/libaccessvdb.so" "$out/scans" 0.1 "$out/field" | tee "$out/counts.txt"
grep -qE '^accessible [1-9]' "$out/counts.txt"
grep -qE '^blocked [1-9]' "$out/counts.txt"

# range_noise.txt beside the scans says 0; the plug-in uses the default of 0.02 m.
"$PROGRAM" map --scans "$out/scans" --poses "$out/scans/poses.txt" --tool builtin:pruner --voxel 0.1 --range-noise 0.02 \
  --quiet --out "$out/program"
rows() { LC_ALL=C sed '1,/^end_header$/d' "$1"; }  # the header names the tool's file, for example
cmp <(rows "$out/field/points.ply") <(rows "$out/program/points.ply")

# Errors are reported, with the program's exit codes.
expect() {  # CODE TEXT ARGUMENT...
  local code=0 text=$2
  "$out/plugin" "${@:3}" >/dev/null 2>"$out/stderr" || code=$?
  [[ $code == "$1" ]] && grep -q "$text" "$out/stderr" || { echo "code $code, expected $1 and '$text': $(<"$out/stderr")"; exit 1; }
}
library=$WORK/moved/$LIBDIR/libaccessvdb.so
expect 2 usage
expect 3 "cannot open" "$out/none.so" "$out/scans"
expect 3 "no scans" "$library" "$out"
expect 2 voxel_size_m "$library" "$out/scans" 0
echo "not a folder" >"$out/file"
expect 7 "$out/file" "$library" "$out/scans" 0.1 "$out/file/field"

# The same for the plug-in made by the build, which is in the examples' own list.
"$MAP_SCANS_IN_C" "$SHARED_LIBRARY" "$out/scans" 0.1 | cmp - "$out/counts.txt"
