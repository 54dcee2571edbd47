#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Scoring reads NanoVDB views only: no object of the CPU backend may ask the linker for a symbol of OpenVDB.
#   check_symbols.sh OBJECT...
set -euo pipefail
(($# > 0)) || { echo "no objects given"; exit 1; }
command -v nm >/dev/null || { echo "skipped: nm (binutils) is missing"; exit 77; }

bad=0
for object in "$@"; do
  # Checks undefined and weak symbols: inlined OpenVDB templates are weak. nanovdb:: is another namespace.
  found=$(nm -C "$object" | grep -E '(^|[^[:alnum:]_])openvdb::' || true)
  if [[ -n $found ]]; then
    printf '%s uses OpenVDB:\n%s\n' "$object" "$(head -5 <<<"$found")"
    bad=1
  fi
done
exit $bad
