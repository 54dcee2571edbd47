#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing, builds with warnings as errors, runs the tests: all of them with --all, else without those
# of tests/long_tests.txt and without benchmarks. The last line is the count:
#   N passed, N failed[, N skipped]
# Further arguments go to ctest, for example: ./tools/test.sh -L parity
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
build=build/ci
long=$(grep -v '^#' tests/long_tests.txt | sed 's/[][().*+?^$|\\]/\\&/g')
settings=(-DACCESSVDB_BUILD_BENCHMARKS=OFF) choice=(-E "^(${long//$'\n'/|})\$")
arguments=()
for argument in "$@"; do
  case $argument in
    --all) settings=(-DACCESSVDB_BUILD_BENCHMARKS=ON) choice=() ;;
    -R | --tests-regex) choice=() && arguments+=("$argument") ;;  # who names tests means them
    *) arguments+=("$argument") ;;
  esac
done
results=$PWD/$build/test-results.xml

stop_before_tests() {
  echo "test: error: $* No test ran; this counts as one failure." >&2
  echo "0 passed, 1 failed"
  exit 1
}

./tools/setup_debian.sh --tests || stop_before_tests "the set-up failed, see above."
./tools/build_preset.sh ci "${settings[@]}" || stop_before_tests "the build failed, see above."

rm -f "$results"
ctest_code=0
ctest --test-dir "$build" -j "$(nproc)" --output-on-failure --no-tests=error --output-junit "$results" \
  ${choice[@]+"${choice[@]}"} ${arguments[@]+"${arguments[@]}"} || ctest_code=$?
[[ -s $results ]] || stop_before_tests "ctest wrote no results (its exit code was $ctest_code)."

# One line per test: passed, skipped or failed, then its name. A test that could not be started is a failure, not a skip.
outcomes=$(awk '
  function finish() { if (name != "") print outcome, name; name = "" }
  function attribute(key,   text) {
    if (!match($0, key "=\"[^\"]*\"")) return ""
    text = substr($0, RSTART, RLENGTH); sub(key "=\"", "", text); sub(/"$/, "", text); return text
  }
  /<testcase / {
    finish(); name = attribute("name"); status = attribute("status")
    outcome = status == "run" ? "passed" : status == "disabled" ? "skipped" : "failed"
  }
  /<skipped / && status == "notrun" && /SKIP_RETURN_CODE|SKIP_REGULAR_EXPRESSION/ { outcome = "skipped" }
  END { finish() }' "$results")

count() { grep -c "^$1 " <<<"$outcomes" || true; }
passed=$(count passed) failed=$(count failed) skipped=$(count skipped)

echo
if ((skipped > 0)); then
  echo "Skipped:"
  sed -n 's/^skipped /  /p' <<<"$outcomes"
fi
if ((failed > 0)); then
  echo "Failed:"
  sed -n 's/^failed /  /p' <<<"$outcomes"
fi
((${#choice[@]} == 0)) || echo "Not run: the long tests (tests/long_tests.txt); --all runs them, too."
echo "$passed passed, $failed failed$( ((skipped == 0)) || echo ", $skipped skipped")"
((failed == 0 && passed > 0 && ctest_code == 0))
