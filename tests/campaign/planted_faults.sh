#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Shows that the campaign finds what it looks for: plants three faults, one after the other, in a copy of the sources (a
# length that is not checked in one reader, a refusal without its line, a damaged file that opens a label), builds it, and
# runs the two programs of tools/campaign.sh on it, at most ten minutes each. Prints how soon each was found, and by which
# run. Not part of ctest: it builds the program three times.
#
#   tests/campaign/planted_faults.sh [--seed 1] [--minutes 10] [unchecked_length missing_line opened_label]
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
seed=1 minutes=10 faults=()
while (($# > 0)); do
  case $1 in
    --seed) seed=$2 && shift 2 ;;
    --minutes) minutes=$2 && shift 2 ;;
    *) faults+=("$1") && shift ;;
  esac
done
((${#faults[@]} > 0)) || faults=(unchecked_length missing_line opened_label)
copy=$(mktemp -d "${TMPDIR:-/tmp}/accessvdb_planted_XXXXXX")
workers=()
stop() {
  ((${#workers[@]} == 0)) || kill -- "${workers[@]/#/-}" 2>/dev/null || true
  workers=()
}
trap 'stop; rm -rf "$copy"' EXIT
(cd "$root" && git ls-files -z | xargs -0 cp -P --parents -t "$copy")
build() { (cd "$copy" && ./tools/build_preset.sh ci accessvdb_cli accessvdb_lab fuzz_readers >build.log 2>&1) || { tail -20 "$copy/build.log"; exit 2; }; }
build
bin=$copy/build/ci/bin
python3 "$root/tests/campaign/corpus.py" --bin "$bin" --out "$copy/corpus" >/dev/null

missed=0
set -m  # each worker is a group of its own, to be stopped with its children
for fault in "${faults[@]}"; do
  patch -s -d "$copy" -p1 <"$root/tests/campaign/planted/$fault.patch"
  build
  : >"$copy/found"
  # Parts of growing seeds, as in tools/campaign.sh.
  (for part in $(seq 0 999); do
    "$bin/fuzz_readers" "$copy/corpus" --runs 20000 --seed $((seed * 1000 + part)) --workers 1 || true
  done) >>"$copy/found" 2>&1 & workers+=($!)
  python3 "$root/tests/campaign/fuzz_program.py" --bin "$bin" --corpus "$copy/corpus" --seconds $((minutes * 60)) \
    --seed "$seed" --workers 1 >>"$copy/found" 2>&1 & workers+=($!)
  disown -a  # the shell is not to say how they end
  began=$SECONDS
  while ! grep -q '^run ' "$copy/found" && ((SECONDS - began < 60 * minutes)); do sleep 1; done
  took=$((SECONDS - began))
  stop
  if grep -q '^run ' "$copy/found"; then
    echo "$fault: found after $took s: $(grep -m 1 '^run ' "$copy/found" | cut -c1-200)"
  else
    echo "$fault: not found within $minutes minutes"
    missed=$((missed + 1))
  fi
  patch -s -R -d "$copy" -p1 <"$root/tests/campaign/planted/$fault.patch"
done
((missed == 0))
