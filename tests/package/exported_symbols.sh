#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# libaccessvdb.so exports only the public API and the C API: exported_symbols.sh [LIBRARY [INCLUDE_FOLDER]]
set -euo pipefail
library=${1:-$SHARED_LIBRARY}
headers=${2:-$SOURCE/include/accessvdb}
command -v nm >/dev/null || { echo "skipped: nm (binutils) is missing"; exit 77; }
bad=0

symbols=$(nm -D --defined-only "$library" | awk '{ print $NF }' | sed 's/@.*//')
[[ -n $symbols ]] || { echo "$library exports nothing"; exit 1; }

# C: exactly the functions of the header.
declared=$(grep -oE '\baccessvdb_[a-z0-9_]+\(' "$headers/c_api.h" | tr -d '(' | LC_ALL=C sort -u)
exported=$(grep -E '^accessvdb_' <<<"$symbols" | LC_ALL=C sort -u)
diff <(echo "$declared") <(echo "$exported") || { echo "the C functions differ: < declared, > exported"; bad=1; }

files=$(find "$headers" -name '*.h')
# C++: only names of namespaces and classes that a public header marks with ACCESSVDB_API.
# shellcheck disable=SC2086  # one word per file
classes=$(grep -ohE '(class|struct) ACCESSVDB_API [A-Za-z0-9]+' $files | awk '{ print $3 }')
# shellcheck disable=SC2086
functions=$(grep -ohE 'ACCESSVDB_API [^;(]*[ &*][A-Za-z0-9_]+\(' $files | sed -E 's/.*[ &*]([A-Za-z0-9_]+)\($/\1/')
public=$(printf '%s\n' "$classes" "$functions" | grep -v '^accessvdb_' | LC_ALL=C sort -u | paste -sd '|')
foreign=$(grep -vE '^accessvdb_' <<<"$symbols" | c++filt |
  grep -vE "^((typeinfo|typeinfo name|vtable|guard variable) for )?accessvdb::((io|tiles)::)?($public)(\b|\[)" || true)
if [[ -n $foreign ]]; then
  echo "exported, but not of the public API:"
  head -20 <<<"$foreign"
  bad=1
fi
while read -r name; do
  c++filt <<<"$symbols" | grep -E "^((typeinfo|vtable) for )?accessvdb::((io|tiles)::)?$name\b" >/dev/null || { echo "public, but not exported: $name"; bad=1; }
done < <(tr '|' '\n' <<<"$public")
internal=$(c++filt <<<"$symbols" | grep -E '^accessvdb::[A-Za-z:]*::(Impl|~Impl)\b' || true)
if [[ -n $internal ]]; then
  echo "exported, but private:"
  head -20 <<<"$internal"
  bad=1
fi
exit $bad
