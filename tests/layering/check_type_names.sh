#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Checks that no two types in some archives have one name, in whatever namespaces: check_type_names.sh ARCHIVE...
# Two in one namespace are one to the linker, which keeps the functions of either; two in different namespaces are one to
# the reader. Prints one line per name, and exits 1 if there is any. Types in unnamed namespaces are not looked at.
set -euo pipefail
(($# > 0)) || { echo "no archives given"; exit 1; }
command -v nm >/dev/null || { echo "skipped: nm (binutils) is missing"; exit 77; }

violations=$(nm -C --defined-only "$@" 2>/dev/null | awk '
  {
    while (match($0, /accessvdb::([a-z_0-9]+::)*[A-Z][A-Za-z0-9]*/)) {
      name = substr($0, RSTART, RLENGTH)
      $0 = substr($0, RSTART + RLENGTH)
      if (name in seen) continue
      seen[name] = 1
      type = name
      sub(/.*::/, "", type)
      named[type] = named[type] " " name
      ++times[type]
    }
  }
  END { for (type in times) if (times[type] > 1) print "type-name: " type " is" named[type] }' | LC_ALL=C sort)
if [[ -n $violations ]]; then
  echo "$violations"
  exit 1
fi
