#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Changes everything that is read, for as long as you like: first each reader in processes of its own, then the whole
# program. Prints each run that was wrong, with how to repeat it, and a last line for the record in
# docs/benchmarks/campaigns.md.
#
#   tools/campaign.sh --minutes 10 --seed 1 [--build build/ci] [--workers 2] [--keep FOLDER] [--sanitized]
#
# --sanitized: the build is that of the preset asan or tsan, which takes more memory and time.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
minutes=1 seed=1 build=build/ci workers=$(nproc) keep="" sanitized=()
while (($# > 0)); do
  case $1 in
    --minutes) minutes=$2 && shift 2 ;;
    --seed) seed=$2 && shift 2 ;;
    --build) build=$2 && shift 2 ;;
    --workers) workers=$2 && shift 2 ;;
    --keep) keep=$2 && shift 2 ;;
    --sanitized) sanitized=(--sanitized) && shift ;;
    *) echo "campaign: error: unknown argument $1. See the first lines of this file." >&2 && exit 2 ;;
  esac
done
corpus=$build/campaign_corpus
[[ -d $corpus ]] || /usr/bin/python3 tests/campaign/corpus.py --bin "$build/bin" --out "$corpus"

# Half of the time for the readers, in parts of growing seeds, so that the time is kept.
wrong=0 runs=0 part=0
end=$(($(date +%s) + minutes * 30))
while (($(date +%s) < end)); do
  out=$("$build/bin/fuzz_readers" "$corpus" --runs 20000 --seed $((seed * 1000 + part)) --workers "$workers" \
    ${keep:+--keep "$keep"}) || true
  grep -E '^run ' <<<"$out" || true
  last=$(tail -n 1 <<<"$out")
  runs=$((runs + ${last%% *})) wrong=$((wrong + $(sed -E 's/.*, ([0-9]+) wrong$/\1/' <<<"$last")))
  part=$((part + 1))
done
program=$(/usr/bin/python3 tests/campaign/fuzz_program.py --bin "$build/bin" --corpus "$corpus" --seconds $((minutes * 30)) \
  --seed "$seed" --workers "$workers" "${sanitized[@]}") || true
grep -E '^run ' <<<"$program" || true
last=$(tail -n 1 <<<"$program")
wrong=$((wrong + $(sed -E 's/.*, ([0-9]+) wrong$/\1/' <<<"$last")))
echo "seed $seed, $minutes minutes: $runs runs of readers, ${last%, *}; $wrong wrong"
((wrong == 0))
