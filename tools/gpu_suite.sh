#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Everything that can only be checked on a machine with an NVIDIA GPU, in one go, with a record of it:
#   gpu_suite.sh PROGRAMS OUT [--commit ID] [--only tests,faults,realdata,sanitizers,ceilings,scoring,stream,bench] [--points N]
#                [--frames N] [--rows 20mm_tau0.1m,10mm_tau4v,...] [--row-seconds N] [--bench-points N]
#                [--bench-options "..."] [--data FOLDER]
# PROGRAMS: the folder of an unpacked portable archive (accessvdb-portable), or a build's bin folder. Writes
# OUT/record.json, the source of the figures in docs/benchmarks/, and a log per step. Fails if a step fails or something
# that it needs is missing: nothing is skipped silently. `realdata` maps recorded scans on both devices; scans missing
# from the test data folder (--data, else ACCESSVDB_TEST_DATA, else shared/data here or beside here) are skipped by name.
# Each row of `bench` may take --row-seconds; a row that is stopped keeps the figures of its finished frames and counts
# as failed.
set -uo pipefail
programs=${1:?usage: gpu_suite.sh PROGRAMS OUT [--commit ID] [--only STEPS]}
out=${2:?usage: gpu_suite.sh PROGRAMS OUT [--commit ID] [--only STEPS]}
shift 2
commit=unknown only=tests,faults,realdata,sanitizers,ceilings,scoring,stream,bench points=1000000 frames=300
wanted_rows= row_seconds=65 bench_points=3200000 bench_options= data=${ACCESSVDB_TEST_DATA:-}
while (($# > 1)); do
  case $1 in
    --commit) commit=$2 ;;
    --only) only=$2 ;;
    --points) points=$2 ;;
    --frames) frames=$2 ;;
    --rows) wanted_rows=$2 ;;
    --row-seconds) row_seconds=$2 ;;
    --bench-points) bench_points=$2 ;;
    --bench-options) bench_options=$2 ;;
    --data) data=$2 ;;
    *) echo "gpu_suite: error: unknown option $1" >&2; exit 2 ;;
  esac
  shift 2
done
mkdir -p "$out"
bin=$programs
if [[ -d $programs/programs ]]; then
  bin=$programs/programs
  export LD_LIBRARY_PATH=$programs/libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
fi
export ACCESSVDB_REQUIRE_GPU=1
failures=0
steps=()

wanted() { [[ ,$only, == *,$1,* ]]; }
record_step() {  # record_step NAME OUTCOME JSON_MEMBERS
  steps+=("{\"step\": \"$1\", \"outcome\": \"$2\"${3:+, $3}}")
  echo "gpu_suite: $1: $2${3:+ ($3)}"
  [[ $2 == passed || $2 == skipped ]] || failures=$((failures + 1))
}
# Counts of a GoogleTest log, as JSON members.
gtest_counts() {
  local passed failed skipped
  passed=$(grep -c '^\[       OK \]' "$1" || true)
  failed=$(grep -c '^\[  FAILED  \] [^ ]* (' "$1" || true)
  skipped=$(grep -c '^\[  SKIPPED \] [^ ]* (' "$1" || true)
  echo "\"passed\": $passed, \"failed\": $failed, \"skipped\": $skipped"
}
seconds_since() { awk -v a="$1" -v b="$(date +%s.%N)" 'BEGIN { printf "%.1f", b - a }'; }

if ! command -v nvidia-smi >/dev/null; then
  echo "gpu_suite: error: nvidia-smi is missing; is there an NVIDIA driver?" >&2
  exit 6
fi
IFS=, read -r gpu driver memory < <(nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader | head -1 | sed 's/, /,/g')
cores=$(nproc)

if wanted tests; then
  start=$(date +%s.%N)
  if "$bin/gpu_parity_test" >"$out/tests.log" 2>&1; then outcome=passed; else outcome=failed; fi
  record_step parity "$outcome" "$(gtest_counts "$out/tests.log"), \"seconds\": $(seconds_since "$start")"
  [[ $outcome == passed ]] || grep -E 'FAILED|Failure|error' "$out/tests.log" | head -20
  injection=$(grep -c '^\[       OK \] CudaMemory' "$out/tests.log" || true)
  if ((injection >= 5)); then outcome=passed; else outcome=failed; fi
  record_step out_of_memory_injection "$outcome" "\"passed\": $injection"
fi

# Makes every CUDA call of a field fail once: at the start, in the middle of a run, for lack of memory.
if wanted faults; then
  start=$(date +%s.%N)
  if "$bin/gpu_faults_test" >"$out/faults.log" 2>&1; then outcome=passed; else outcome=failed; fi
  # The device must have been real: every test has run, none was skipped.
  (($(grep -c '^\[       OK \] DeviceFaults' "$out/faults.log" || true) >= 6)) || outcome=failed
  record_step device_faults "$outcome" "$(gtest_counts "$out/faults.log"), \"seconds\": $(seconds_since "$start")"
  [[ $outcome == passed ]] || grep -E 'FAILED|Failure|error' "$out/faults.log" | head -20
fi

# The counts of a report.json, or the points of a points.ply, without what identifies the run.
report_counts() { awk '/^  "counts"/ { on = 1 } on { print } on && /^  }/ { exit }' "$1/report.json"; }
ply_points() { LC_ALL=C sed '1,/^end_header$/d' "$1/points.ply"; }
# Recorded scans on both devices: NAME, the folder that they need, and the flags of `map`.
if wanted realdata; then
  for folder in shared/data ../shared/data; do
    [[ -z $data && -d $folder ]] && data=$folder
  done
  while read -r name needs options; do
    if [[ -z $data || ! -e $data/$needs ]]; then
      record_step "realdata_$name" skipped "\"problem\": \"no test data $needs\""
      continue
    fi
    start=$(date +%s.%N)
    outcome=passed
    for device in cpu cuda; do
      # shellcheck disable=SC2086  # options, one word each
      "$bin/accessvdb" map --device "$device" --out "$out/real_${name}_$device" ${options//DATA/$data} \
        >"$out/real_${name}_$device.log" 2>&1 </dev/null || outcome=failed
    done
    cpu=$out/real_${name}_cpu cuda=$out/real_${name}_cuda
    members="\"seconds\": $(seconds_since "$start")"
    if [[ $outcome == passed ]]; then
      grep -q '^  "device": "cuda:' "$cuda/report.json" && grep -q '^  "device": "cpu"' "$cpu/report.json" || outcome=failed
      equal=false same=false
      [[ $(report_counts "$cpu") == "$(report_counts "$cuda")" ]] && equal=true
      cmp -s <(ply_points "$cpu") <(ply_points "$cuda") && same=true
      # Runs that scored nothing would agree too.
      scored=$(report_counts "$cuda" | awk -F'[:,]' '/"(accessible|blocked)"/ { sum += $2 } END { print sum + 0 }')
      [[ $equal == true && $same == true ]] && ((scored > 0)) || outcome=failed
      counts=$(report_counts "$cuda" | grep -E '"(scans|points_used|surface_points|accessible|blocked|unscored)"' |
        tr -d ' \n' | sed 's/,$//; s/:/: /g; s/,/, /g')
      members="\"counts_equal\": $equal, \"points_equal\": $same, $counts, $members"
    fi
    record_step "realdata_$name" "$outcome" "$members"
    rm -f "$cpu"/*.vdb "$cuda"/*.vdb "$cpu"/*.ply "$cuda"/*.ply
  done <<'CASES'
balm_pruner scans_poses_balm/alidarPose.csv --scans DATA/scans_poses_balm --poses DATA/scans_poses_balm/alidarPose.csv --tool builtin:pruner --voxel 0.05
balm_updates scans_poses_balm/alidarPose.csv --scans DATA/scans_poses_balm --poses DATA/scans_poses_balm/alidarPose.csv --tool builtin:pruner --voxel 0.05 --update-every 2 --directions 60
kitti kitti_00/poses.txt --scans DATA/kitti_00/velodyne --poses DATA/kitti_00/poses.txt --calib DATA/kitti_00/calib.txt --tool builtin:pruner --voxel 0.1
mid360_frame livox_mid360/frame_20240509061326.pcd --scans DATA/livox_mid360/frame_20240509061326.pcd --sensor-at 0,0,0 --tool builtin:pencil --voxel 0.05
CASES
fi

if wanted sanitizers; then
  sanitizer=$(command -v compute-sanitizer || find /usr/local/cuda/bin /opt/nvidia -name compute-sanitizer 2>/dev/null | head -1)
  if [[ -z $sanitizer ]]; then
    record_step sanitizers failed "\"problem\": \"compute-sanitizer is missing\""
  else
    # Streams: one with a thin tool, and three short ones: a tool counted by its slabs, voxels so small that blocks are
    # taken in groups, and a tool so thick that it takes leaves as a whole. Two more with a queue: one per policy.
    checked=CudaScoring.ShortRunOfEveryPath:CudaScoring.NothingToScoreIsNothing:CudaMirror.ArenaTakesAnyBytes
    checked+=:CudaMemory.NothingIsAllocatedOnceWarm:CudaDistance.NothingIsAllocatedOnceWarm
    checked+=:ShortStream.HasAToolWithSlabsThatBlocks
    checked+=:Streams/CudaStream.EqualsTheCpuAfterEveryUpdate/1:ShortStream/CudaStream.EqualsTheCpuAfterEveryUpdate/0
    checked+=:ShortStream/CudaStream.EqualsTheCpuAfterEveryUpdate/1
    checked+=:ShortStream/CudaStream.EqualsTheCpuAfterEveryUpdate/2
    checked+=:ShortStream/CudaBudget.OnlyDelays/0:ShortStream/CudaPaper.EvaluatesTheSamePointsAsTheCpu/0
    expected=$(tr -cd : <<<":$checked" | wc -c)
    for tool in memcheck racecheck initcheck synccheck; do
      start=$(date +%s.%N)
      "$sanitizer" --tool "$tool" --error-exitcode 9 "$bin/gpu_parity_test" \
        --gtest_filter="$checked" >"$out/$tool.log" 2>&1
      code=$?
      errors=$(sed -n 's/.*ERROR SUMMARY: \([0-9]*\).*/\1/p; s/.*RACECHECK SUMMARY: \([0-9]*\) hazards.*/\1/p' "$out/$tool.log" | tail -1)
      # A filter that matches nothing would pass too: every test of the filter must have run.
      ran=$(grep -c '^\[       OK \]' "$out/$tool.log" || true)
      if ((code == 0 && ran == expected)) && [[ $errors == 0 ]]; then outcome=passed; else outcome=failed; fi
      record_step "$tool" "$outcome" "\"errors\": ${errors:-null}, $(gtest_counts "$out/$tool.log"), \"seconds\": $(seconds_since "$start")"
      [[ $outcome == passed ]] || grep -v '^\[' "$out/$tool.log" | head -30
    done
  fi
fi

# The machine's limits. Runs before everything that is timed, and writes to most of the free memory: a virtual machine
# may get its memory only then, and frames would wait for it.
ceilings=null
if wanted ceilings; then
  start=$(date +%s.%N)
  gigabytes=$(awk '/^MemAvailable:/ { free = 0.7e-6 * 1.024 * $2; print int(free < 90 ? free : 90) }' /proc/meminfo)
  if "$bin/accessvdb_bench_ceilings" "$out/ceilings.json" "$gigabytes" 2>&1 | tee "$out/ceilings.log"; then outcome=passed; else outcome=failed; fi
  record_step ceilings "$outcome" "\"seconds\": $(seconds_since "$start")"
  [[ -s $out/ceilings.json ]] && ceilings=$(cat "$out/ceilings.json")
fi

scoring=null
if wanted scoring; then
  start=$(date +%s.%N)
  if "$bin/accessvdb_bench_gpu" --points "$points" --out "$out/scoring.json" 2>&1 | tee "$out/scoring.log"; then outcome=passed; else outcome=failed; fi
  record_step scoring_benchmark "$outcome" "\"seconds\": $(seconds_since "$start")"
  [[ -s $out/scoring.json ]] && scoring=$(cat "$out/scoring.json")
fi

stream=null
if wanted stream; then
  start=$(date +%s.%N)
  ACCESSVDB_BENCH_FRAMES=$frames "$bin/accessvdb_bench_stream" --benchmark_filter='/20/' --benchmark_out="$out/stream.json" \
    --benchmark_out_format=json >"$out/stream.log" 2>&1
  if [[ $? == 0 && -s $out/stream.json ]]; then outcome=passed; else outcome=failed; fi
  record_step stream_benchmark "$outcome" "\"frames\": $frames, \"seconds\": $(seconds_since "$start")"
  # Only the counters: the rest identifies the machine.
  [[ -s $out/stream.json ]] && stream=$(awk '/"benchmarks"/ { on = 1 } on' "$out/stream.json" |
    grep -E '"(name|points|tests|full_tests|percent|dirty|integrate_ms|mirror_ms|update_ms|score_ms)":' |
    awk 'BEGIN { printf "{" } { sub(/,$/, ""); printf "%s%s", (NR > 1 ? ", " : ""), $0 } END { print "}" }')
fi

# A flight through pines, timed over 200 frames past bench_points surface points. Rows: NAME VOXEL TAU and flags.
bench=null
if wanted bench; then
  rows=()
  while read -r name voxel tau flags; do
    [[ -z $wanted_rows || ,$wanted_rows, == *,$name,* ]] || continue
    start=$(date +%s.%N)
    rm -f "$out/bench_$name.json"
    # shellcheck disable=SC2086  # options, one word each
    timeout -s INT -k 10 "$row_seconds" "$bin/accessvdb" bench --scene pine --device cuda --voxel "$voxel" --tau "$tau" \
      --frames 1200 --timed-frames 200 --shortest --min-surface-points "$bench_points" $flags $bench_options \
      --out "$out/bench_$name.json" --per-frame "$out/bench_$name.csv" >"$out/bench_$name.log" 2>&1 </dev/null
    code=$?
    if ((code == 0)); then outcome=passed; else outcome=failed; fi
    record_step "bench_$name" "$outcome" "\"exit_code\": $code, \"seconds\": $(seconds_since "$start")"
    grep -E 'the last|surface points|error' "$out/bench_$name.log"
    [[ -s $out/bench_$name.json ]] && rows+=("$(cat "$out/bench_$name.json")")
  done <<'ROWS'
20mm_tau0.1m 0.02 0.1
10mm_tau0.1m 0.01 0.1
5mm_tau0.1m 0.005 0.1
10mm_tau4v 0.01 4v
5mm_tau4v 0.005 4v
10mm_budget 0.01 0.1 --budget-points 200000
20mm_paper 0.02 0.1 --policy paper --budget-points 20000
ROWS
  bench=$(printf '[\n%s]' "$(for n in "${!rows[@]}"; do echo "${rows[n]}$( ((n + 1 < ${#rows[@]})) && echo ,)"; done)")
fi

{
  echo "{\"schema\": 1, \"date\": \"$(date -u +%Y-%m-%d)\", \"commit\": \"$commit\", \"device\": \"$gpu\", \"driver\": \"$driver\","
  echo " \"device_memory\": \"$memory\", \"cpu_cores\": $cores, \"failures\": $failures, \"steps\": ["
  for n in "${!steps[@]}"; do echo "  ${steps[n]}$( ((n + 1 < ${#steps[@]})) && echo ,)"; done
  echo " ],"
  echo " \"ceilings\": $ceilings,"
  echo " \"scoring\": $scoring,"
  echo " \"stream\": $stream,"
  echo " \"bench\": $bench}"
} >"$out/record.json"
echo "gpu_suite: $failures failed; record in record.json"
((failures == 0))
