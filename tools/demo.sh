#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing, builds, makes sample scans of a walk past trees and computes which of their surfaces a pruner
# can reach. Everything is written below out/demo; run it as often as you like.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
out=out/demo
bin=build/release/bin

./tools/setup_debian.sh
# CUDA code takes minutes to compile and does not run without a driver. A direct build of the preset includes it if nvcc
# is found.
cuda=-DACCESSVDB_CUDA=OFF
if [[ -e /proc/driver/nvidia/version ]] || command -v nvidia-smi >/dev/null; then cuda=-DACCESSVDB_CUDA=AUTO; fi
./tools/build_preset.sh release "$cuda" -DACCESSVDB_LAB=OFF -DACCESSVDB_DDS=OFF -DACCESSVDB_PYTHON=OFF -DACCESSVDB_PCL=OFF \
  accessvdb_cli make_sample_scans >&2

# Scans of the last run are reused if the settings and the program that made them are the same.
settings="--frames 40 --rays 20000 --seed 1 --range-noise 0.01"
stamp=$out/sample_scans.stamp
wanted="$settings $(cksum <"$bin/make_sample_scans")"
if [[ ! -f $stamp || $(<"$stamp") != "$wanted" ]]; then
  rm -rf "$out/scans" "$stamp"
  mkdir -p "$out"
  # shellcheck disable=SC2086  # the settings are several words on purpose
  "$bin/make_sample_scans" --out "$out/scans" $settings >&2
  echo "$wanted" >"$stamp"
fi

"$bin/accessvdb" map --scans "$out/scans" --poses "$out/scans/poses.txt" --tool builtin:pruner --voxel 0.05 --out "$out/field" \
  --html

cat <<END

Done. Open these:
  any browser                   $PWD/$out/field/report.html
  picture                       $PWD/$out/field/preview.png
  Blender, Houdini, ParaView    $PWD/$out/field/field.vdb
  CloudCompare, MeshLab         $PWD/$out/field/points.ply
  counts, timing, parameters    $PWD/$out/field/report.json
END
