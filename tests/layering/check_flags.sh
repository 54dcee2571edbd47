#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Labels are equal on every backend only if no compiler contracts or reorders arithmetic: every translation unit of ours
# must be compiled with -ffp-contract=off and without any fast-math flag; CUDA code with --fmad=false, IEEE division and
# square root, and denormals kept.
#   check_flags.sh compile_commands.json      exit code 77 (skipped) if the build did not export it
set -euo pipefail
commands=${1:?usage: check_flags.sh compile_commands.json}
if [[ ! -f $commands ]]; then
  echo "skipped: no $commands; configure with a preset or -DCMAKE_EXPORT_COMPILE_COMMANDS=ON"
  exit 77
fi

awk '
  /"command":/ { command = $0 " " }
  /"file":/ {
    file = $0; sub(/^[^:]*: *"/, "", file); sub(/".*/, "", file); ++files
    if (file !~ /\.cu$/ && command !~ / -ffp-contract=off /) { print file ": compiled without -ffp-contract=off"; bad = 1 }
    if (file ~ /\.cu$/) {
      count = split("fmad=false prec-div=true prec-sqrt=true ftz=false", flags, " ")
      for (n = 1; n <= count; ++n)
        if (command !~ (" --?" flags[n] " ")) { print file ": compiled without -" flags[n]; bad = 1 }
    }
    # A later flag overrides an earlier one.
    if (command ~ / (-Ofast|-ffast-math|-funsafe-math-optimizations|-fassociative-math|-freciprocal-math|-ffp-contract=(fast|on)|--?use_fast_math|--?fmad=true|--?prec-div=false|--?prec-sqrt=false|--?ftz=true) /) {
      print file ": compiled with a fast-math flag"; bad = 1
    }
    command = ""
  }
  END {
    if (files == 0) { print "no translation unit found"; bad = 1 }
    exit bad
  }' "$commands"
