#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Each line of tests/long_tests.txt is the name of a test of the build: check_long_tests.sh SOURCE BUILD
set -euo pipefail
export LC_ALL=C
tests=$(ctest --test-dir "${2:?usage: check_long_tests.sh SOURCE BUILD}" -N | sed -n 's/^ *Test *#[0-9]*: //p' | sort)
unknown=$(comm -23 <(grep -v '^#' "$1/tests/long_tests.txt" | sort) - <<<"$tests")
[[ -z $unknown ]] || { echo "tests/long_tests.txt: no test has this name: $unknown"; exit 1; }
