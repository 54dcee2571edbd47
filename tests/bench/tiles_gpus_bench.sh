#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# What a second GPU brings: all tiles of a generated survey on one GPU with 16 cores, then on two with 32, both by
# accessvdb.tiles and Dask. Prints one line per run, the efficiency T1 / (2 T2), and whether the merged files are equal.
#   tiles_gpus_bench.sh PROGRAM WORK [COPIES] [PROCESSES_PER_GPU] [ROUNDS]
# PROGRAM: accessvdb, with accessvdb-lab beside it; WORK: a new folder. In the environment: PYTHON, an interpreter with the modules distributed and
# accessvdb; VOXEL and TILES, in metres; PLAIN=1: by plain processes, run_tiles_plainly.py, where Dask is not installed.
set -euo pipefail
program=$(realpath -s "${1:?usage: tiles_gpus_bench.sh PROGRAM WORK [COPIES] [PROCESSES_PER_GPU] [ROUNDS]}")
work=${2:?a new folder}
copies=${3:-256} per_gpu=${4:-8} rounds=${5:-3}
python=${PYTHON:-python3} voxel=${VOXEL:-0.02} tiles=${TILES:-10.24}
benches=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
tools=$(cd "$benches/../../tools" && pwd)
mkdir "$work"
cd "$work"
export ACCESSVDB_PROGRAM=$program
"$program-lab" simulate --scene pine --frames 60 --range-noise 0.02 --out tree >simulate.log 2>&1
python3 "$tools/repeat_scans.py" tree survey --copies "$copies" --spacing 8
"$program" tile plan planned --scans survey/scans --poses survey/poses.txt --tool builtin:pruner --voxel "$voxel" --tiles "$tiles" --device cuda >plan.log 2>&1
seconds() { date +%s.%N; }
start=$(seconds)
"$program" tile bin planned >bin.log 2>&1
echo "bin: $(awk -v a="$start" -v b="$(seconds)" 'BEGIN { printf "%.1f", b - a }') s, $("$program" tile list planned --todo | wc -l) tiles"

mapped() {  # mapped GPUS CORES FOLDER: prints the seconds from the first tile to the last
  rm -rf "$3"
  cp -r planned "$3"
  if [[ ${PLAIN:-0} == 1 ]]; then
    taskset -c "0-$(($2 - 1))" python3 "$benches/run_tiles_plainly.py" "$program" "$3" --gpus "$1" --per-gpu "$per_gpu" --threads 2 >"$3.log"
    sed 's/ s, .*//' "$3.log"
    return
  fi
  taskset -c "0-$(($2 - 1))" "$python" -m accessvdb.tiles run "$3" --gpus "$1" --per-gpu "$per_gpu" --keep-rays \
    --threads-per-worker 2 >"$3.log" 2>&1 || { tail -5 "$3.log" >&2; exit 1; }
  grep ' mapped ' "$3.log" | sed 's/^[^:]*: //' >&2
  sed -n 's/.* mapped .* in \([0-9.]*\) s.*/\1/p' "$3.log"
}
for ((round = 1; round <= rounds; ++round)); do
  one=$(mapped 0 16 one)
  two=$(mapped 0,1 32 two)
  awk -v one="$one" -v two="$two" 'BEGIN { printf "one GPU %.1f s, two %.1f s: T1 / (2 T2) = %.2f\n", one, two, one / (2 * two) }'
done
for folder in one two; do "$program" tile merge $folder --keep-rays --points $folder.ply >/dev/null 2>&1; done
cmp one.ply two.ply && echo "the merged files are equal"
