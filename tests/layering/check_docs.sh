#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Everything that documents, sources and scripts cite is in the repository. check_docs.sh [ROOT]
# - documents: link targets, headings that links name, and paths in backticks that begin with a folder of the repository;
# - all texts: no SPEC, INTERFACE or issue number; X.md in capitals or below docs/ is a document, and `docs/X.md,
#   "Heading"` has that heading. Names in lower case without a folder, such as tables.md, are files that a program writes.
set -euo pipefail
cd "${1:-$(dirname "${BASH_SOURCE[0]}")/../..}"

missing=0
shopt -s nullglob
for document in ./*.md docs/*.md docs/*/*.md; do
  while read -r from target; do
    [[ -e $from/$target ]] || { echo "$document: '$target' does not exist"; missing=1; }
  done < <(
    grep -oE '\]\([^)#]+' "$document" | sed 's/^](//' | grep -vE '^[a-z]+:' | sed "s|^|$(dirname "$document") |" || true
    grep -oE '`(\./)?(include|src|nanovdb_kernels|tools|tests|examples|docs|cmake)/[A-Za-z0-9_./-]+[A-Za-z0-9_]' "$document" |
      sed 's/^`/. /' || true
  )
done

# Links to a heading: GitHub's name of it is its words in lower case, joined by hyphens, without punctuation.
while read -r problem; do
  echo "$problem"
  missing=1
done < <(awk '
  function resolved(from, to,   parts, n, i, path, kept) {  # "docs/a/../b.md" -> "docs/b.md"
    path = from
    if (to != "") { sub(/[^\/]*$/, "", path); path = path to }
    n = split(path, parts, "/"); kept = 0; path = ""
    for (i = 1; i <= n; ++i) { if (parts[i] == "..") --kept; else if (parts[i] != ".") parts[++kept] = parts[i] }
    for (i = 1; i <= kept; ++i) path = path (i > 1 ? "/" : "") parts[i]
    return path
  }
  FNR == 1 { code = 0; self = resolved(FILENAME, ""); known[self] = 1 }
  /^```/ { code = !code }
  !code && /^#+ / {
    name = tolower($0); sub(/^#+ */, "", name); gsub(/\]\([^)]*\)/, "", name); gsub(/[^a-z0-9_ -]/, "", name); gsub(/ /, "-", name)
    heading[self "#" name] = 1
  }
  { for (rest = $0; match(rest, /\]\([^)#: ]*#[^) ]+\)/); rest = substr(rest, RSTART + RLENGTH)) {
      split(substr(rest, RSTART + 2, RLENGTH - 3), link, "#")
      wanted[++count] = resolved(self, link[1]) "#" link[2]; text[count] = FILENAME ": \047" link[1] "#" link[2] "\047 is no heading"
  } }
  END { for (i = 1; i <= count; ++i) { split(wanted[i], link, "#"); if (link[1] in known && !(wanted[i] in heading)) print text[i] } }
' ./*.md docs/*.md docs/*/*.md)

texts=(./*.md ./CMakeLists.tx[t] ./*.cff)  # globs: a tree may lack any of them
for folder in .ci cmake docs examples include nanovdb_kernels python src tests tools; do
  [[ -d $folder ]] && texts+=("$folder")
done
# This check and its test have to name what they look for.
everywhere() { grep -rnIE --exclude='check_docs*.sh' --exclude-dir=__pycache__ "$@" "${texts[@]}" || true; }

report() {  # report PROBLEM, with grep's lines on standard input
  local line
  while IFS= read -r line; do
    echo "${line%%:*}: $1: ${line#*:}"
    missing=1
  done
}
report 'cites what the repository does not have' < <(
  everywhere '\bSPEC\b|\b[Ii]ssue #?[0-9]'
  everywhere '\bINTERFACE\b' --exclude=CMakeLists.txt --exclude='*.cmake' --exclude='*.cmake.in'
)

declare -A named
for document in ./*.md docs/*.md docs/*/*.md tools/*/*.md; do named[${document##*/}]=1; done
while IFS=: read -r file line name; do
  [[ $name == docs/* && -e $name || $name != docs/* && -n ${named[${name##*/}]:-} ]] ||
    { echo "$file: line $line cites the document '$name', which does not exist"; missing=1; }
done < <(everywhere -o '\bdocs/[A-Za-z0-9_/-]+\.md\b|\b[A-Z][A-Z_]+\.md\b')

while IFS=: read -r file line citation; do
  document=${citation%%.md*}.md heading=${citation#*\"}
  [[ ! -e $document ]] || grep -qxE "#+ ${heading%\"}" "$document" ||
    { echo "$file: line $line cites $citation, which is no heading there"; missing=1; }
done < <(everywhere -o '\bdocs/[A-Za-z0-9_/-]+\.md`?, "[^":]+"')
exit $missing
