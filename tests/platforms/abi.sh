#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# What a patch release keeps (CONTRIBUTING.md, "Releases"): the symbols of libaccessvdb.so and the layout of the public
# types, against a list in the repository.
#   abi.sh check LIST LIBRARY OBJECT HEADERS      fails with one line if anything of the list is gone or the list lacks something
#   abi.sh write LIST LIBRARY OBJECT HEADERS      writes the list; of a released version, only to add to it
# OBJECT: of the public headers, with debug information of all types. What accessvdb/program has is not kept.
set -euo pipefail
mode=$1 list=$2 library=$3 object=$4 headers=$5
here=$(dirname "${BASH_SOURCE[0]}")
command -v readelf >/dev/null && command -v c++filt >/dev/null || { echo "skipped: readelf or c++filt (binutils) is missing"; exit 77; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Functions that are inline in a header are in a consumer, too; whether the library has a copy is the compiler's choice.
# They are weak, as are tables of virtual functions and names of types, which consumers need.
LC_ALL=C readelf -W --dyn-syms "$library" | awk '$7 != "UND" && $8 ~ /accessvdb/ && ($5 == "GLOBAL" || $8 ~ /^_ZT[VIS]/) { sub(/@.*/, "", $8); print $8 }' |
  sort -u >"$work/symbols"
# shellcheck disable=SC2046  # one word per header
internal=$(grep -ohE '(class|struct) ACCESSVDB_API [A-Za-z0-9]+|ACCESSVDB_API [^;(]*[ &*][A-Za-z0-9_]+\(' $(find "$headers/program" -name '*.h') |
  sed -E 's/\($//; s/.*[ &*]//' | LC_ALL=C sort -u | paste -sd '|')
{
  paste -d '\t' "$work/symbols" <(c++filt <"$work/symbols") | grep -vE "	(non-virtual thunk to |(vtable|typeinfo|typeinfo name) for )?accessvdb::((io|tiles)::)?($internal)\b" |
    sed 's/\t.*//; s/^/symbol /'
  LC_ALL=C readelf --debug-dump=info "$object" 2>/dev/null | awk -f "$here/abi_layout.awk"
} | LC_ALL=C sort -u >"$work/now"
for kind in symbol type field; do
  grep -q "^$kind " "$work/now" || { echo "abi: error: no $kind found: is $library the shared library, and $object of GCC with -g -fno-eliminate-unused-debug-types?"; exit 1; }
done

command="cmake --build BUILD --target abi_list"
state='not released'
if [[ -e $list ]]; then
  state=$(sed -n '1s/^# State: \(released\|not released\)$/\1/p' "$list")
  [[ -n $state ]] || { echo "abi: error: the first line of $list is neither '# State: released' nor '# State: not released'"; exit 1; }
  grep -v '^#' "$list" | LC_ALL=C sort -u >"$work/kept"
elif [[ $mode == check ]]; then
  echo "abi: error: there is no list ${list##*/} for this version. Write it: $command"
  exit 1
else
  : >"$work/kept"
fi

# A fact is lost if the same kind and name has another number or is not there. A struct of C may grow: its caller says
# which size it knows, and its fields stay where they are.
awk '
  function spoken(kind, name, number) {
    if (kind == "symbol") return "the symbol " name
    if (kind == "type") return name " with " number " bytes"
    if (kind == "value") return name " = " number
    return name " at " (kind == "virtual" ? "place " : "byte ") number
  }
  { name = $2; number = $3; for (i = 4; i <= NF; ++i) number = number " " $i }
  FILENAME == ARGV[1] { now[$1, name] = number; there[$1, name] = 1; next }
  { kept[$1, name] = 1 }
  !(($1, name) in there) { print "lost\t" $2 "\t" spoken($1, name, number) " is gone"; next }
  now[$1, name] != number && !($1 == "type" && name ~ /^accessvdb_/ && now[$1, name] + 0 > number + 0) {
    print "lost\t" $2 "\t" spoken($1, name, number) " is now " spoken($1, name, now[$1, name]); next
  }
  now[$1, name] != number { print "new\t" $2 "\t" spoken($1, name, now[$1, name]) }
  END { for (key in there) if (!(key in kept)) { split(key, parts, SUBSEP); print "new\t" parts[2] "\t" spoken(parts[1], parts[2], now[key]) } }
' "$work/now" "$work/kept" | LC_ALL=C sort >"$work/changes"
say() {  # say KIND: the first change of the kind, with its readable name, and how many more there are
  local first symbol count
  count=$(grep -c "^$1	" "$work/changes")
  first=$(grep -m 1 "^$1	" "$work/changes")
  symbol=$(cut -f 2 <<<"$first")
  first=$(cut -f 3 <<<"$first")
  first=${first//"$symbol"/"$(c++filt "$symbol")"}
  ((count == 1)) && echo "$first" || echo "$first, and $((count - 1)) more"
}
lost=$(grep -c '^lost' "$work/changes" || true)
if ((lost > 0)) && [[ $state == released ]]; then
  echo "abi: error: $(say lost). A patch release keeps it: put it back, or raise the minor version in CMakeLists.txt and write its list: $command"
  exit 1
fi
if [[ $mode == write ]]; then
  {
    echo "# State: $state"
    echo "# What programs built with this version find in later patch releases, too (CONTRIBUTING.md, "\"Releases\""). Written by $command"
    cat "$work/now"
  } >"$list.tmp"
  mv "$list.tmp" "$list"
  echo "$list: $(wc -l <"$work/now") facts, $lost lost, $(grep -c '^new' "$work/changes" || true) new"
  exit 0
fi
((lost == 0)) || { echo "abi: error: $(say lost), and ${list##*/} has it. If that is meant, write the list again: $command"; exit 1; }
[[ ! -s $work/changes ]] || { echo "abi: error: new and not in ${list##*/}: $(say new). Write it there, so that patch releases keep it: $command"; exit 1; }
