#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# What vdb_print and the Python module of OpenVDB say about the files of `map`: names, types, classes, units, transform,
# origin offset, parameters, tool, version, up axis, counts.   check_metadata.sh ACCESSVDB ACCESSVDB_LAB
set -euo pipefail
program=${1:?usage: check_metadata.sh ACCESSVDB ACCESSVDB_LAB}
lab=${2:?usage: check_metadata.sh ACCESSVDB ACCESSVDB_LAB}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

fail() { echo "check_metadata: $*" >&2; exit 1; }

command -v vdb_print >/dev/null || fail "vdb_print is missing. On Debian and Ubuntu: apt install libopenvdb-tools"
# The Python that the distribution's module is for; it need not be the first one on the path.
python=
for candidate in /usr/bin/python3 python3; do
  if "$candidate" -c 'import numpy, importlib.util as u; assert u.find_spec("pyopenvdb") or u.find_spec("openvdb")' 2>/dev/null; then python=$candidate; break; fi
done
[[ -n $python ]] || fail "no Python imports pyopenvdb and numpy. On Debian and Ubuntu: apt install python3-openvdb python3-numpy"

"$lab" simulate --scene sphere --sensor mid360 --trajectory orbit --frames 6 --seed 3 --out "$work/scans" --quiet \
  2>"$work/log" || fail "simulate failed: $(cat "$work/log")"
map() {  # map OUT OPTIONS...
  local out=$1; shift
  "$program" map --scans "$work/scans/scans" --poses "$work/scans/poses.txt" --tool builtin:pencil --voxel 0.005 \
    --out "$work/$out" --quiet "$@" 2>"$work/log" || fail "map $* failed: $(cat "$work/log")"
}
map plain
map other --up-axis y --half --compression zip --surface

expect() {  # expect FILE REGEX: some line matches
  grep -qE "$2" "$1" || fail "no line like '$2' in what vdb_print says of the ${1##*/} of '$run'"
}
for run in plain other; do
  up=z halves=false
  [[ $run == plain ]] || { up=y; halves=true; }
  vdb_print -m "$work/$run/field.vdb" >"$work/grids" || fail "vdb_print cannot read field.vdb of $run"
  vdb_print -m "$work/$run/field_points.vdb" >"$work/points" || fail "vdb_print cannot read field_points.vdb of $run"
  for grid in density accessible blocked confidence score distance weight; do expect "$work/grids" "^$grid +float "; done
  expect "$work/grids" '^best_direction +vec3s '
  expect "$work/grids" '^cleared +bool '
  for line in "up_axis: $up" 'length_unit: m' 'class: fog volume' 'class: unknown' 'value_unit: observations' \
    'voxel size: 0.005' "is_saved_as_half_float: $halves" 'origin_W_x: '; do
    expect "$work/grids" "^ +$line"
  done
  for line in "up_axis: $up" 'length_unit: m' 'voxel_size_m: 0.005' 'origin_W_x: ' 'tool: builtin:pencil' 'tool_sha256: [0-9a-f]{64}$' \
    'accessvdb_version: ' 'truncation_distance_m: ' 'num_directions: 180'; do
    expect "$work/grids" "^$line"
  done
  expect "$work/points" '^points +ptdataidx32 '
  expect "$work/points" "^ +up_axis: $up"
done
expect "$work/grids" '^surface +float '
expect "$work/grids" '^ +class: level set'

"$python" "$here/read_field.py" "$work/plain" z float 9
"$python" "$here/read_field.py" "$work/other" y half 10
