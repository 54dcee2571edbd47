#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The parts of gpu_suite.sh add up to one record, with a stand-in for the program whose times are known: 10 ms that do
# not depend on the threads and 90 ms that are divided among them, so 10 % is serial.
set -euo pipefail
suite=$(cd "$(dirname "${BASH_SOURCE[0]}")/../../tools" && pwd)/gpu_suite.sh
command -v python3 >/dev/null || { echo "skipped: python3 is missing"; exit 77; }
folder=$WORK/gpu_suite
rm -rf "$folder"
mkdir -p "$folder/bin"
export PATH=$folder/bin:$PATH
cat >"$folder/bin/nvidia-smi" <<'END'
#!/bin/sh
echo "Some GPU, 1.2, 3 MiB"
END
cat >"$folder/bin/nproc" <<'END'
#!/bin/sh
echo 8
END
cat >"$folder/bin/accessvdb-lab" <<'END'
#!/usr/bin/env bash
all="$*" threads=1
while (($# > 0)); do
  case $1 in
    --threads) threads=$2 ;;
    --out) out=$2 ;;
  esac
  shift
done
echo "$all" >>"$CALLS"
ms=$(awk -v n="$threads" 'BEGIN { print 10 + 90 / n }')
printf '{\n  "schema": 1,\n  "timing_ms": {\n' >"$out"
for stage in frame integrate mirror update score; do
  printf '    "%s": {\n      "mean": %s,\n      "p95": 1\n    }%s\n' "$stage" "$ms" "$([[ $stage == score ]] || echo ,)" >>"$out"
done
printf '  },\n  "timing_all_frames_ms": {\n    "frame": {\n      "mean": 7\n    }\n  }\n}\n' >>"$out"
[[ $all != *"$FAILING"* ]] || exit 4
END
# racecheck hangs in its second test.
cat >"$folder/bin/compute-sanitizer" <<'END'
#!/usr/bin/env bash
for last in "$@"; do :; done
n=0
IFS=: read -ra tests <<<"${last#--gtest_filter=}"
for test in "${tests[@]}"; do
  echo "[ RUN      ] $test"
  ((++n < 2)) || [[ $* != *racecheck* ]] || sleep 60
  echo "[       OK ] $test (1 ms)"
done
echo "========= ERROR SUMMARY: 0 errors"
END
chmod +x "$folder"/bin/*
export CALLS=$folder/calls FAILING=nothing
bad=0
expect() {  # expect WHAT VALUE WANTED
  [[ $2 == "$3" ]] || { echo "$1: '$2', not '$3'"; bad=1; }
}
suite_code() {
  local code=0
  "$suite" "$@" >>"$folder/log" 2>&1 || code=$?
  echo "$code"
}
calls() { wc -l <"$CALLS"; }
of_record() { python3 -c "import json, sys; r = json.load(open('$1/record.json')); print($2)"; }

began=$(date +%s)
expect "a tool that hangs" "$(suite_code "$folder/bin" "$folder/hangs" --only sanitizers --sanitizer-seconds 1)" 1
expect "how long it takes" "$(($(date +%s) - began < 30))" 1
outcomes="[(s['step'], s['outcome'], s.get('stopped_in')) for s in r['steps'] if s['step'] in ('memcheck', 'racecheck')]"
expect "what is said of it" "$(of_record "$folder/hangs" "$outcomes")" \
  "[('memcheck', 'passed', None), ('racecheck', 'failed', 'CudaScoring.NothingToScoreIsNothing')]"

: >"$CALLS"
one=$folder/one
expect "the processor's rows" "$(suite_code "$folder/bin" "$one" --commit abc --only cpu)" 0
expect "rows that fit 8 cores" "$(calls)" 4
expect "skipped by name" "$(grep -c 'bench_cpu_.*_16t.*skipped' "$folder/log")" 2
expect threads "$(of_record "$one" "r['scaling']['frame']['threads']")" "[1, 2, 4, 8]"
expect times "$(of_record "$one" "r['scaling']['frame']['mean_ms']")" "[100, 55, 32.5, 21.25]"
expect "serial share" "$(of_record "$one" "r['scaling']['update']['serial_percent']")" "[None, 10.0, 10.0, 10.0]"
expect "one GPU row" "$(suite_code "$folder/bin" "$one" --commit abc --only bench --rows orbit_10mm)" 0
expect "added to the record" "$(of_record "$one" "[row['row'] for row in r['bench'] + r['cpu']]")" \
  "['orbit_10mm', 'cpu_50mm_1t', 'cpu_50mm_2t', 'cpu_50mm_4t', 'cpu_50mm_8t']"
expect "its GPU" "$(of_record "$one" "(r['device'], r['cpu_cores'], r['commit'])")" "('Some GPU', 8, 'abc')"
: >"$CALLS"
FAILING="--path orbit --max-range 20"
expect "a row fails" "$(suite_code "$folder/bin" "$one" --commit abc --only bench --rows 'orbit_*')" 1
expect "not measured again" "$(calls)" 5
expect failures "$(of_record "$one" "r['failures']")" 2
FAILING=nothing
expect "the failed ones again" "$(suite_code "$folder/bin" "$one" --commit abc --only bench --rows 'orbit_*')" 0
expect "only those" "$(calls)" 7
expect "nothing failed" "$(of_record "$one" "(r['failures'], len(r['steps']))")" "(0, 12)"

three=$folder/three
FAILING="--threads 4"
expect "a row of the processor fails" "$(suite_code "$folder/bin" "$three" --only cpu)" 1
expect "the others scale" "$(of_record "$three" "r['scaling']['frame']['threads']")" "[1, 2, 8]"
FAILING=nothing

two=$folder/two
expect "no time for any row" "$(suite_code "$folder/bin" "$two" --commit abc --only bench --rows 'hover_*' --minutes 1)" 3
expect "some time" "$(suite_code "$folder/bin" "$two" --commit abc --only bench --rows 'hover_*,flight_20mm' --minutes 4)" 3
expect "the shorter rows" "$(of_record "$two" "[row['row'] for row in r['bench']]")" \
  "['flight_20mm', 'hover_20mm', 'hover_10mm', 'hover_20mm_paper', 'hover_10mm_paper']"
expect "another commit" "$(suite_code "$folder/bin" "$two" --commit other --only bench)" 2
all=$folder/all
expect join "$(suite_code --join "$all" "$one" "$two")" 0
expect "all of both" "$(of_record "$all" "(len(r['bench']), len(r['cpu']), r['commit'])")" "(11, 4, 'abc')"
expect "no part" "$(suite_code --join "$all" "$folder/bin")" 2
((bad == 0)) || tail -40 "$folder/log"
exit $bad
