#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Builds everything with sanitizers and runs the suites; prints each finding and their number, and fails unless that is 0.
#   tools/test_sanitized.sh asan           address, undefined behaviour, leaks; tools/test_sanitized.sh tsan: races, after
#   tests/sanitizers/build_tbb.sh SOURCE   once
#   tools/test_sanitized.sh asan -L live   arguments go to ctest
# Reports go to files, since a program may expect that its children fail. Suppressions, with their reasons:
# tests/sanitizers. To run one program by hand: eval "$(tools/test_sanitized.sh asan --environment)".
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
preset=${1:?usage: test_sanitized.sh asan|tsan [--environment | CTEST_ARGUMENT...]}
shift
build=$PWD/build/$preset suppressions=$PWD/tests/sanitizers
reports=$build/findings
# What may end a program is what each sanitizer offers; 99 is no code of ours.
common=exitcode=99:log_path=$reports/report
declare -A options=()
case $preset in
  asan)
    options[ASAN_OPTIONS]=$common:detect_stack_use_after_return=1:strict_string_checks=1:check_initialization_order=1
    # Fast DDS 2.9 deletes objects of 88 bytes as their base of 56 in ~RTPSWriter, so that each program with a
    # participant would end there; a report's kind can only be turned off for all.
    options[ASAN_OPTIONS]+=:new_delete_type_mismatch=0
    options[LSAN_OPTIONS]=suppressions=$suppressions/lsan.supp:print_suppressions=0
    options[UBSAN_OPTIONS]=$common:halt_on_error=1:print_stacktrace=1:suppressions=$suppressions/ubsan.supp
    # Long sums in suites whose code the others run as well.
    left_out=(-LE golden)
    ;;
  tsan)
    options[TSAN_OPTIONS]=$common:suppressions=$suppressions/tsan.supp:second_deadlock_stack=1
    options[LD_LIBRARY_PATH]=$build/tbb
    # Live, asynchronous updates, tiles, rolling fields, output checks. What reads a mesh or a .vdb file starts a thread in a child of a
    # process with threads (src/io/streams/guarded_child.h), which this sanitizer does not support.
    left_out=(-R 'Live|PoseBuffer|AsyncUpdate|BackgroundUpdate|DeviceAhead|DeviceHost|LeadingMap|LeavesReadBeside|^MadeAgain|MapFollower|Ticket|Shard|TileId|OutputCheck|DiskThread|RollingResume|^sanitizers')
    ;;
  *) echo "test_sanitized: error: no preset $preset with sanitizers: asan or tsan" >&2 && exit 2 ;;
esac
if [[ ${1:-} == --environment ]]; then
  for name in "${!options[@]}"; do echo "export $name='${options[$name]}'"; done
  exit 0
fi

./tools/build_preset.sh "$preset"
rm -rf "$reports"
mkdir -p "$reports"
for name in "${!options[@]}"; do export "$name=${options[$name]}"; done
code=0
ctest --test-dir "$build" -j "$(nproc)" --output-on-failure --no-tests=error "${left_out[@]}" "$@" || code=$?
found=0 suppressed=0
while read -r report; do
  [[ -n $report ]] || continue
  if head -n 8 "$report" | tr '\n' ' ' | grep -qEf <(grep -vE '^(#|$)' "$suppressions/asan.supp"); then
    suppressed=$((suppressed + 1))
  else
    found=$((found + 1))
    echo "$report: $(grep -m1 -E 'ERROR: |WARNING: |runtime error: ' "$report" | cut -c1-200)"
  fi
done < <(find "$reports" -type f | LC_ALL=C sort)
echo "$found findings, $suppressed suppressed"
((code == 0 && found == 0))
