#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Everything that can only be checked on a machine with an NVIDIA GPU, with a record of it:
#   gpu_suite.sh PROGRAMS OUT [--commit ID] [--only tests,faults,realdata,sanitizers,ceilings,scoring,stream,bench,cpu] [--points N]
#                [--frames N] [--rows PATTERN,...] [--minutes N] [--row-seconds N] [--sanitizer-seconds N] [--bench-points N]
#                [--bench-options "..."] [--data FOLDER]
#   gpu_suite.sh --join OUT PART...      joins the folders of parts that ran on one machine
# PROGRAMS: the folder of an unpacked portable archive (accessvdb-portable), or a build's bin folder. Writes
# OUT/record.json, the source of the figures in docs/benchmarks/, and a log per step. Fails if a step fails or something
# that it needs is missing: nothing is skipped silently. `realdata` maps recorded scans on both devices; scans missing
# from the test data folder (--data, else ACCESSVDB_TEST_DATA, else shared/data here or beside here) are skipped by name.
# Parts: a call adds to the record of earlier calls with the same OUT, and rows of `bench` and `cpu` that have their
# figures are not measured again. With --minutes N no row begins that might end later; code 3 says that rows are left:
#   while gpu_suite.sh PROGRAMS OUT --only bench,cpu --minutes 8; (($? == 3)); do :; done
# --rows takes names or patterns such as 'orbit_*'. A row that takes longer than its limit (--row-seconds for all rows)
# is stopped, keeps the figures of its finished frames and counts as failed; so is a sanitizer's tool after
# --sanitizer-seconds (300), and the record names the test that it was in. `cpu` needs no GPU.
set -uo pipefail
programs=${1:?usage: gpu_suite.sh PROGRAMS OUT [--commit ID] [--only STEPS]}
out=${2:?usage: gpu_suite.sh PROGRAMS OUT [--commit ID] [--only STEPS]}
shift 2
parts=()
if [[ $programs == --join ]]; then
  (($# > 0)) || { echo "gpu_suite: error: --join needs the folders of the parts" >&2; exit 2; }
  parts=("$@")
  set --
fi
commit=unknown only=tests,faults,realdata,sanitizers,ceilings,scoring,stream,bench,cpu points=1000000 frames=300
wanted_rows= minutes= row_seconds= sanitizer_seconds=300 bench_points=3200000 bench_options= data=${ACCESSVDB_TEST_DATA:-}
while (($# > 1)); do
  case $1 in
    --commit) commit=$2 ;;
    --only) only=$2 ;;
    --points) points=$2 ;;
    --frames) frames=$2 ;;
    --rows) wanted_rows=$2 ;;
    --minutes) minutes=$2 ;;
    --row-seconds) row_seconds=$2 ;;
    --sanitizer-seconds) sanitizer_seconds=$2 ;;
    --bench-points) bench_points=$2 ;;
    --bench-options) bench_options=$2 ;;
    --data) data=$2 ;;
    *) echo "gpu_suite: error: unknown option $1" >&2; exit 2 ;;
  esac
  shift 2
done
mkdir -p "$out"
started=$(date +%s)
bin=$programs
if [[ -d $programs/programs ]]; then
  bin=$programs/programs
  export LD_LIBRARY_PATH=$programs/libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
fi
export ACCESSVDB_REQUIRE_GPU=1

wanted() { [[ ${#parts[@]} == 0 && ,$only, == *,$1,* ]]; }
# Steps are kept in OUT, one a line: NAME, OUTCOME, JSON. A step that runs again replaces its line.
steps=$out/steps.tsv
touch "$steps"
outcome_of() { awk -F '\t' -v name="$1" '$1 == name { print $2 }' "$steps"; }
keep_step() {  # keep_step NAME OUTCOME JSON
  awk -F '\t' -v name="$1" '$1 != name' "$steps" >"$steps.new"
  printf '%s\t%s\t%s\n' "$1" "$2" "$3" >>"$steps.new"
  mv "$steps.new" "$steps"
}
record_step() {  # record_step NAME OUTCOME JSON_MEMBERS
  keep_step "$1" "$2" "{\"step\": \"$1\", \"outcome\": \"$2\"${3:+, $3}}"
  echo "gpu_suite: $1: $2${3:+ ($3)}"
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

gpu=none driver=none memory=none cores=$(nproc)
if [[ ${#parts[@]} == 0 && $only != cpu ]]; then
  if ! command -v nvidia-smi >/dev/null; then
    echo "gpu_suite: error: nvidia-smi is missing; is there an NVIDIA driver? (--only cpu needs none)" >&2
    exit 6
  fi
  IFS=, read -r gpu driver memory < <(nvidia-smi --query-gpu=name,driver_version,memory.total --format=csv,noheader | head -1 | sed 's/, /,/g')
fi
# What the parts of one record must have in common. The processor's rows alone do not name the GPU.
same_machine() {  # same_machine "COMMIT|GPU|DRIVER|MEMORY|CORES": adopts or compares
  local known=
  [[ ! -s $out/machine.txt ]] || known=$(<"$out/machine.txt")
  if [[ -z $known || $known == *"|none|none|none|"* && ${known%%|*} == "${1%%|*}" && ${known##*|} == "${1##*|}" ]]; then
    echo "$1" >"$out/machine.txt"
  elif [[ $known != "$1" && $1 != "${known%%|*}|none|none|none|${known##*|}" ]]; then
    echo "gpu_suite: error: $out has figures of '$known', these are of '$1'. Use another folder." >&2
    exit 2
  fi
}
if ((${#parts[@]} > 0)); then
  for part in "${parts[@]}"; do
    [[ -s $part/machine.txt && -e $part/steps.tsv ]] || { echo "gpu_suite: error: $part is no part of a record" >&2; exit 2; }
    same_machine "$(<"$part/machine.txt")"
    find "$part" -maxdepth 1 -name '*.json' ! -name record.json -exec cp {} "$out/" \;
    while IFS=$'\t' read -r name outcome json; do keep_step "$name" "$outcome" "$json"; done <"$part/steps.tsv"
  done
else
  same_machine "$commit|$gpu|$driver|$memory|$cores"
fi
IFS='|' read -r commit gpu driver memory cores <"$out/machine.txt"

if wanted tests; then
  start=$(date +%s.%N)
  if "$bin/gpu_parity_test" >"$out/tests.log" 2>&1; then outcome=passed; else outcome=failed; fi
  record_step parity "$outcome" "$(gtest_counts "$out/tests.log"), \"seconds\": $(seconds_since "$start")"
  [[ $outcome == passed ]] || grep -E 'FAILED|Failure|error' "$out/tests.log" | head -20
  injection=$(grep -c '^\[       OK \] CudaMemory' "$out/tests.log" || true)
  if ((injection >= 5)); then outcome=passed; else outcome=failed; fi
  record_step out_of_memory_injection "$outcome" "\"passed\": $injection"
  # Points of the surface, chosen on the GPU: tiles of a plan against one piece on the processor, and a rolling map
  # against a field without a limit.
  start=$(date +%s.%N)
  for test in tiles_equal_one_piece_test rolling_field_test; do
    ACCESSVDB_TILE_DEVICE=cuda "$bin/$test" --gtest_filter='*/points_of_surface'
  done >"$out/tiles.log" 2>&1
  if (($(grep -c '^\[       OK \]' "$out/tiles.log" || true) == 2)); then outcome=passed; else outcome=failed; fi
  record_step tiles_of_surface_points "$outcome" "$(gtest_counts "$out/tiles.log"), \"seconds\": $(seconds_since "$start")"
  [[ $outcome == passed ]] || grep -E 'FAILED|Failure|error' "$out/tiles.log" | head -20
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
mid360_frame livox_mid360/frame_20240509061326.pcd --scans DATA/livox_mid360/frame_20240509061326.pcd --sensor-at 0,0,0 --tool builtin:pencil --voxel 0.05 --allow-hidden-tool
CASES
fi

if wanted sanitizers; then
  sanitizer=$(command -v compute-sanitizer || find /usr/local/cuda/bin /opt/nvidia -name compute-sanitizer 2>/dev/null | head -1)
  if [[ -z $sanitizer ]]; then
    record_step sanitizers failed "\"problem\": \"compute-sanitizer is missing\""
  else
    # Streams: one with a thin tool, and five short ones: a tool counted by its slabs, voxels so small that blocks are
    # taken in groups, a tool so thick that it takes leaves as a whole, one that tilts and rolls, and a wide set. Two
    # more with a queue, one per policy, and two that score points of the surface, one with more to a cell than are listed.
    checked=CudaScoring.ShortRunOfEveryPath:CudaScoring.NothingToScoreIsNothing:CudaMirror.ArenaTakesAnyBytes
    checked+=:CudaMemory.NothingIsAllocatedOnceWarm:CudaDistance.NothingIsAllocatedOnceWarm
    checked+=:ShortStream.HasAToolWithSlabsThatBlocks
    checked+=:Streams/CudaStream.EqualsTheCpuAfterEveryUpdate/1:ShortStream/CudaStream.EqualsTheCpuAfterEveryUpdate/0
    checked+=:ShortStream/CudaStream.EqualsTheCpuAfterEveryUpdate/1
    checked+=:ShortStream/CudaStream.EqualsTheCpuAfterEveryUpdate/2
    checked+=:ShortStream/CudaStream.EqualsTheCpuAfterEveryUpdate/3
    checked+=:ShortStream/CudaStream.EqualsTheCpuAfterEveryUpdate/4:CudaWide.ShortRun
    checked+=:ShortStream/CudaStream.PipelinedEqualsTheCpu/0:ShortStream/CudaSurface.EqualsTheCpuAfterEveryUpdate/0
    checked+=:ShortStream/CudaBudget.OnlyDelays/0:ShortStream/CudaPaper.EvaluatesTheSamePointsAsTheCpu/0
    checked+=:OfTheSurface/CudaNeighbours.AreThoseOfTheCpuInAwkwardPlaces/0:FitsOnDevice.ShortRun
    checked+=:FusionTwin.MoreReturnsInAVoxelThanTheSumsOfAllWarpsCanHold
    expected=$(tr -cd : <<<":$checked" | wc -c)
    for tool in memcheck racecheck initcheck synccheck; do
      start=$(date +%s.%N)
      # It looks at shared memory, which no other kernel sees, and with kernels side by side it does not always end.
      options=()
      [[ $tool != racecheck ]] || options=(--force-blocking-launches)
      # One that does not end would cost the other steps, too.
      timeout -k 5 "$sanitizer_seconds" "$sanitizer" --tool "$tool" --error-exitcode 9 ${options[@]+"${options[@]}"} "$bin/gpu_parity_test" \
        --gtest_filter="$checked" >"$out/$tool.log" 2>&1
      code=$?
      stopped=
      ((code != 124 && code != 137)) ||
        stopped=", \"stopped_in\": \"$(sed -n 's/^\[ RUN      \] //p' "$out/$tool.log" | tail -1)\""
      errors=$(sed -n 's/.*ERROR SUMMARY: \([0-9]*\).*/\1/p; s/.*RACECHECK SUMMARY: \([0-9]*\) hazards.*/\1/p' "$out/$tool.log" | tail -1)
      # A filter that matches nothing would pass too: every test of the filter must have run.
      ran=$(grep -c '^\[       OK \]' "$out/$tool.log" || true)
      if ((code == 0 && ran == expected)) && [[ $errors == 0 ]]; then outcome=passed; else outcome=failed; fi
      record_step "$tool" "$outcome" "\"errors\": ${errors:-null}, $(gtest_counts "$out/$tool.log"), \"seconds\": $(seconds_since "$start")$stopped"
      [[ $outcome == passed ]] || grep -v '^\[' "$out/$tool.log" | head -30
    done
  fi
fi

# The machine's limits. Runs before everything that is timed, and writes to most of the free memory: a virtual machine
# may get its memory only then, and frames would wait for it.
if wanted ceilings; then
  start=$(date +%s.%N)
  gigabytes=$(awk '/^MemAvailable:/ { free = 0.7e-6 * 1.024 * $2; print int(free < 90 ? free : 90) }' /proc/meminfo)
  if "$bin/accessvdb_bench_ceilings" "$out/ceilings.json" "$gigabytes" 2>&1 | tee "$out/ceilings.log"; then outcome=passed; else outcome=failed; fi
  record_step ceilings "$outcome" "\"seconds\": $(seconds_since "$start")"
fi

if wanted scoring; then
  start=$(date +%s.%N)
  if "$bin/accessvdb_bench_gpu" --points "$points" --out "$out/scoring.json" 2>&1 | tee "$out/scoring.log"; then outcome=passed; else outcome=failed; fi
  record_step scoring_benchmark "$outcome" "\"seconds\": $(seconds_since "$start")"
fi

if wanted stream; then
  start=$(date +%s.%N)
  ACCESSVDB_BENCH_FRAMES=$frames "$bin/accessvdb_bench_stream" --benchmark_filter='/20/1/' --benchmark_out="$out/stream.json" \
    --benchmark_out_format=json >"$out/stream.log" 2>&1
  if [[ $? == 0 && -s $out/stream.json ]]; then outcome=passed; else outcome=failed; fi
  record_step stream_benchmark "$outcome" "\"frames\": $frames, \"seconds\": $(seconds_since "$start")"
  # Only the counters: the rest identifies the machine.
  [[ -s $out/stream.json ]] && awk '/"benchmarks"/ { on = 1 } on' "$out/stream.json" |
    grep -E '"(name|points|tests|full_tests|percent|dirty|integrate_ms|mirror_ms|update_ms|score_ms)":' |
    awk 'BEGIN { printf "{" } { sub(/,$/, ""); printf "%s%s", (NR > 1 ? ", " : ""), $0 } END { print "}" }' >"$out/stream_counters.json"
fi

# Rows of `accessvdb-lab bench`: NAME, most SECONDS, and flags. On the GPU over 200 frames past bench_points surface points;
# where places are seen again, also past the time when more than 6 % of the returns are new, but from frame 1 500 on in
# any case; for the exact policy, with an update after every tenth scan until 20 frames before. On the processor with
# few frames, as a laptop has time for.
again="--frames 1720 --max-new-percent 6 --begin-by 1500"
exact="--warm-up-update-every 10"
paper="--policy paper --budget-points 20000"
bench_rows="
flight_20mm 65 --voxel 0.02 --tau 0.1 --frames 1200
flight_10mm 65 --voxel 0.01 --tau 0.1 --frames 1200
flight_5mm 90 --voxel 0.005 --tau 0.1 --frames 1200
flight_20mm_pipelined 65 --voxel 0.02 --tau 0.1 --frames 1200 --pipelined
flight_10mm_pipelined 65 --voxel 0.01 --tau 0.1 --frames 1200 --pipelined
flight_5mm_pipelined 90 --voxel 0.005 --tau 0.1 --frames 1200 --pipelined
flight_10mm_tau4v 65 --voxel 0.01 --tau 4v --frames 1200
flight_5mm_tau4v 65 --voxel 0.005 --tau 4v --frames 1200
flight_10mm_budget 65 --voxel 0.01 --tau 0.1 --frames 1200 --budget-points 200000
flight_20mm_paper 65 --voxel 0.02 --tau 0.1 --frames 1200 $paper
flight_10mm_paper 65 --voxel 0.01 --tau 0.1 --frames 1200 $paper
flight_5mm_paper 90 --voxel 0.005 --tau 0.1 --frames 1200 $paper
slow_20mm 90 --speed 0.045 --voxel 0.02 --tau 0.1 --frames 1700
slow_10mm 90 --speed 0.1 --voxel 0.01 --tau 0.1 --frames 1200
slow_5mm 120 --speed 0.1 --voxel 0.005 --tau 0.1 --frames 1200
orbit_20mm 150 --path orbit --max-range 20 --voxel 0.02 --tau 0.1 $again $exact
orbit_10mm 180 --path orbit --max-range 10 --voxel 0.01 --tau 0.1 $again $exact
orbit_5mm 300 --path orbit --max-range 6 --voxel 0.005 --tau 0.1 $again $exact
orbit_20mm_paper 150 --path orbit --max-range 20 --voxel 0.02 --tau 0.1 $again $paper
orbit_10mm_paper 180 --path orbit --max-range 10 --voxel 0.01 --tau 0.1 $again $paper
orbit_5mm_paper 480 --path orbit --max-range 6 --voxel 0.005 --tau 0.1 $again $paper
hover_20mm 150 --path hover --max-range 20 --voxel 0.02 --tau 0.1 $again $exact
hover_10mm 180 --path hover --max-range 10 --voxel 0.01 --tau 0.1 $again $exact
hover_5mm 300 --path hover --max-range 6 --voxel 0.005 --tau 0.1 $again $exact
hover_20mm_paper 150 --path hover --max-range 20 --voxel 0.02 --tau 0.1 $again $paper
hover_10mm_paper 180 --path hover --max-range 10 --voxel 0.01 --tau 0.1 $again $paper
hover_5mm_paper 480 --path hover --max-range 6 --voxel 0.005 --tau 0.1 $again $paper"
cpu_rows="
cpu_50mm_1t 240 --threads 1 --voxel 0.05 --frames 40 --timed-frames 15
cpu_50mm_2t 150 --threads 2 --voxel 0.05 --frames 40 --timed-frames 15
cpu_50mm_4t 90 --threads 4 --voxel 0.05 --frames 40 --timed-frames 15
cpu_50mm_8t 65 --threads 8 --voxel 0.05 --frames 40 --timed-frames 15
cpu_50mm_16t 65 --threads 16 --voxel 0.05 --frames 40 --timed-frames 15
cpu_20mm_16t 150 --threads 16 --voxel 0.02 --frames 30 --timed-frames 10"
rows_left=()
wanted_row() {
  local pattern
  [[ -n $wanted_rows ]] || return 0
  # shellcheck disable=SC2053  # patterns
  for pattern in ${wanted_rows//,/ }; do [[ $1 == $pattern ]] && return 0; done
  return 1
}
measure_rows() {  # measure_rows "ROWS" FLAGS...
  local rows=$1 name limit flags threads start code outcome
  shift
  set -f  # patterns of --rows are not file names
  while read -r name limit flags; do
    [[ -n $name ]] && wanted_row "$name" || continue
    [[ $(outcome_of "bench_$name") != passed ]] || continue
    threads=$(sed -n 's/.*--threads \([0-9]*\).*/\1/p' <<<"$flags")
    if ((${threads:-0} > cores)); then
      record_step "bench_$name" skipped "\"problem\": \"only $cores cores\""
      continue
    fi
    limit=${row_seconds:-$limit}
    if [[ -n $minutes ]] && (($(date +%s) - started + limit > 60 * minutes)); then
      rows_left+=("$name")
      continue
    fi
    start=$(date +%s.%N)
    rm -f "$out/bench_$name.json"
    # shellcheck disable=SC2086  # options, one word each
    timeout -s INT -k 10 "$limit" "$bin/accessvdb-lab" bench --scene pine "$@" $flags $bench_options \
      --out "$out/bench_$name.json" --per-frame "$out/bench_$name.csv" >"$out/bench_$name.log" 2>&1 </dev/null
    code=$?
    if ((code == 0)); then outcome=passed; else outcome=failed; fi
    record_step "bench_$name" "$outcome" "\"exit_code\": $code, \"seconds\": $(seconds_since "$start")"
    grep -E 'the last|surface points|error' "$out/bench_$name.log"
  done <<<"$rows"
  set +f
}
if wanted bench; then
  measure_rows "$bench_rows" --device cuda --timed-frames 200 --shortest --min-surface-points "$bench_points"
fi
if wanted cpu; then measure_rows "$cpu_rows" --device cpu; fi

# Rows with figures, in the order of the tables above.
joined_rows() {
  local name separator=
  while read -r name _; do
    [[ -n $name && -s $out/bench_$name.json ]] || continue
    printf '%s' "$separator"
    sed "1s/{/{\n  \"row\": \"$name\",/" "$out/bench_$name.json"
    separator=,
  done <<<"$1"
}
mean_ms() { awk -v stage="\"$2\":" '/"timing_ms"/ { on = 1 } on && $1 == stage { found = 1 } found && /"mean"/ { sub(/,$/, ""); print $2; exit }' "$1"; }
# Times of the 50 mm rows by number of threads. serial_percent is the share that a program of that speed-up would run
# on one thread (Karp and Flatt): e = (t_n / t_1 - 1 / n) / (1 - 1 / n). It counts waiting for memory and for each other.
scaling() {
  local stage n one
  # A row that was stopped has the times of another part of the stream.
  whole() { [[ $(outcome_of "bench_cpu_50mm_${1}t") == passed && -s $out/bench_cpu_50mm_${1}t.json ]]; }
  whole 1 || { echo null; return; }
  printf '{"row": "cpu_50mm"'
  for stage in frame integrate mirror update score; do
    one=$(mean_ms "$out/bench_cpu_50mm_1t.json" "$stage")
    for n in 1 2 4 8 16; do
      whole "$n" && echo "$n $(mean_ms "$out/bench_cpu_50mm_${n}t.json" "$stage")"
    done | awk -v stage="$stage" -v one="$one" '{ threads = threads (NR > 1 ? ", " : "") $1; times = times (NR > 1 ? ", " : "") $2
      serial = serial (NR > 1 ? ", " : "") ($1 > 1 && one > 0 ? sprintf("%.1f", 100 * ($2 / one - 1 / $1) / (1 - 1 / $1)) : "null") }
      END { printf ",\n  \"%s\": {\"threads\": [%s], \"mean_ms\": [%s], \"serial_percent\": [%s]}", stage, threads, times, serial }'
  done
  printf '}'
}
or_null() { if [[ -s $1 ]]; then cat "$1"; else echo null; fi; }

failures=$(awk -F '\t' '$2 != "passed" && $2 != "skipped"' "$steps" | wc -l)
{
  echo "{\"schema\": 1, \"date\": \"$(date -u +%Y-%m-%d)\", \"commit\": \"$commit\", \"device\": \"$gpu\", \"driver\": \"$driver\","
  echo " \"device_memory\": \"$memory\", \"cpu_cores\": $cores, \"failures\": $failures, \"steps\": ["
  awk -F '\t' '{ printf "%s  %s", (NR > 1 ? ",\n" : ""), $3 } END { print "" }' "$steps"
  echo " ],"
  echo " \"ceilings\": $(or_null "$out/ceilings.json"),"
  echo " \"scoring\": $(or_null "$out/scoring.json"),"
  echo " \"stream\": $(or_null "$out/stream_counters.json"),"
  echo " \"bench\": [$(joined_rows "$bench_rows")],"
  echo " \"cpu\": [$(joined_rows "$cpu_rows")],"
  echo " \"scaling\": $(scaling)}"
} >"$out/record.json"
echo "gpu_suite: $failures failed; record in record.json"
((${#rows_left[@]} == 0)) || echo "gpu_suite: no time for ${rows_left[*]}; call again with the same folder"
((failures == 0)) || exit 1
((${#rows_left[@]} == 0)) || exit 3
