#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Which version of the C library each program or shared library needs, and by which symbol; also the versions of the C++
# library. Reads files of any processor.
#   glibc_needed.sh [--limit VERSION] FILE...
# One line per file, separated by tabs: FILE, glibc version, symbol, GLIBCXX version, CXXABI version; '-' for none. With
# --limit, a file that needs more is an error that names it and the symbol.
set -euo pipefail
fail() {
  echo "glibc_needed: error: $*" >&2
  exit 1
}
usage="usage: glibc_needed.sh [--limit VERSION] FILE..."
limit=
if [[ ${1:-} == --limit ]]; then
  limit=${2:-}
  [[ $limit =~ ^[0-9]+\.[0-9]+$ ]] || fail "--limit needs a version such as 2.35. $usage"
  shift 2
fi
(($# > 0)) || fail "no files given. $usage"
command -v readelf >/dev/null || fail "'readelf' is missing: apt install binutils"

# What is no number counts as newer than any: names such as GLIBC_PRIVATE tie a file to one build of the C library, and
# of those that stand for a feature of the loader only GLIBC_ABI_DT_RELR has a known version.
needed_by() {  # needed_by FILE
  readelf -W --dyn-syms -V -- "$1" 2>/dev/null | awk -v file="$1" '
    function newer(a, b,   x, y, i) {
      split(a, x, "."); split(b, y, ".")
      for (i = 1; i <= 3; ++i) if (x[i] + 0 != y[i] + 0) return x[i] + 0 > y[i] + 0
      return 0
    }
    function take(version, symbol,   parts, key) {
      sub(/^@+/, "", version)
      if (version == "GLIBC_ABI_DT_RELR") { version = "GLIBC_2.36"; symbol = "relative relocations, -z pack-relative-relocs" }
      if (version ~ /^GLIBC_/ && version !~ /^GLIBC_[0-9.]+$/) { symbol = symbol " of " version; version = "GLIBC_999" }
      split(version, parts, "_"); key = parts[1]
      if (key != "GLIBC" && key != "GLIBCXX" && key != "CXXABI" || parts[2] !~ /^[0-9.]+$/) return
      if (!(key in most) || newer(parts[2], most[key]) || parts[2] == most[key] && by[key] == "") { most[key] = parts[2]; by[key] = symbol }
    }
    /^Version needs section/ { needs = 1 }
    /^Version definition section/ { needs = 0 }
    needs && match($0, /Name: [^ ]+/) { take(substr($0, RSTART + 6, RLENGTH - 6), "") }
    $7 == "UND" && match($8, /@/) { take(substr($8, RSTART), substr($8, 1, RSTART - 1)) }
    END {
      printf "%s\t%s\t%s\t%s\t%s\n", file, "GLIBC" in most ? most["GLIBC"] : "-", by["GLIBC"] != "" ? by["GLIBC"] : "-",
        "GLIBCXX" in most ? most["GLIBCXX"] : "-", "CXXABI" in most ? most["CXXABI"] : "-"
    }'
}
too_new=
for file in "$@"; do
  readelf -h -- "$file" >/dev/null 2>&1 || fail "$file is no program and no shared library"
  line=$(needed_by "$file")
  echo "$line"
  IFS=$'\t' read -r _ version symbol _ <<<"$line"
  if [[ -n $limit && $version != - && $(printf '%s\n' "$limit" "$version" | sort -V | tail -n 1) != "$limit" ]]; then
    [[ $version != 999 ]] || version="of one build only"
    too_new=${too_new:-"$file needs glibc $version ($symbol), more than $limit"}
  fi
done
[[ -z $too_new ]] || fail "$too_new. Build or replace it on a distribution with an older glibc, or raise the limit."
