#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Puts the licence texts of shared libraries into a folder, one file per Debian package, the common texts that these
# refer to, and ours.
#   collect_licences.sh FOLDER [--sysroot DIR --triplet TRIPLET] [--headers-of BUILD] LIBRARY...
# With --headers-of also those of the headers that this Ninja build compiled in, except the C library's: these describe
# the machine's own library. --sysroot: where the libraries of another processor are. Without dpkg only ours, with a
# warning.
set -euo pipefail
fail() {
  echo "collect_licences: error: $*" >&2
  exit 1
}
usage="usage: collect_licences.sh FOLDER [--sysroot DIR --triplet TRIPLET] [--headers-of BUILD] LIBRARY..."
(($# > 0)) || fail "$usage"
folder=$1 headers_of='' sysroot=''
host_triplet=$(uname -m)-linux-gnu
triplet=$host_triplet
shift
while [[ ${1:-} == --* ]]; do
  case $1 in
    --sysroot) sysroot=${2:?$usage} ;;
    --triplet) triplet=${2:?$usage} ;;
    --headers-of) headers_of=${2:?$usage} ;;
    *) fail "unknown option $1. $usage" ;;
  esac
  shift 2
done
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

# A sysroot that was only unpacked does not know its packages: then this machine's list says which package has a file of
# this name.
texts=("$sysroot/usr/share/doc") owners=(dpkg-query) owners_triplet=$host_triplet
if [[ -n $sysroot ]]; then
  texts+=(/usr/share/doc)  # for the headers of a cross compiler
  if compgen -G "$sysroot/var/lib/dpkg/info/*.list" >/dev/null; then
    owners=(dpkg-query "--admindir=$sysroot/var/lib/dpkg") owners_triplet=$triplet
  fi
fi
known_as() {  # known_as FILE: the names that dpkg may know it by: /lib may be a link to /usr/lib, a link that of its target
  local file
  for file in "$(readlink -f "$1")" "$1"; do
    file=${file#"$sysroot"}
    file=${file/"/$triplet/"/"/$owners_triplet/"}
    echo "$file"
    if [[ $file == /usr/* ]]; then echo "${file#/usr}"; else echo "/usr$file"; fi
  done
}
package_of() {  # package_of FILE
  local file package
  while read -r file; do
    package=$("${owners[@]}" -S "$file" 2>/dev/null | sed -n '/^diversion/d; s/[:,].*//p' | head -n 1 || true)
    [[ -z $package ]] || { echo "$package"; return; }
  done < <(known_as "$1")
}
text_of() {  # text_of PACKAGE: its own, or that of another package from the same source (Ubuntu's libssl-dev has a dangling link)
  local other from texts_of
  from=$("${owners[@]}" -W -f '${source:Package}\n' "$1" 2>/dev/null | head -n 1 || true)
  for other in "$1" $("${owners[@]}" -W -f '${source:Package} ${Package}\n' | awk -v from="$from" 'from != "" && $1 == from { print $2 }'); do
    for texts_of in "${texts[@]}"; do
      [[ ! -s $texts_of/$other/copyright ]] || { echo "$texts_of/$other/copyright"; return; }
    done
  done
}
header_packages() {  # the packages of the headers that were compiled in, from the sysroot and from this machine
  local headers file
  headers=$(ninja -C "$headers_of" -t deps | sed -n "s|^ \+\(\($sysroot\)\?/usr/.*\)|\1|p" | LC_ALL=C sort -u)
  [[ -n $headers ]] || fail "$headers_of is not a Ninja build, or nothing is built there"
  {
    if [[ -n $sysroot ]]; then
      { grep "^$sysroot/" <<<"$headers" || true; } | xargs -r readlink -f | while read -r file; do
        file=${file#"$sysroot"}
        echo "${file/"/$triplet/"/"/$owners_triplet/"}"
      done | { xargs -r "${owners[@]}" -S 2>/dev/null || true; }
      headers=$(grep -v "^$sysroot/" <<<"$headers" || true)
    fi
    xargs -r readlink -f <<<"$headers" | { xargs -r dpkg-query -S 2>/dev/null || true; }
  } | sed '/^diversion/d; s/[:,].*//' | { grep -vE '^(libc6-dev|linux-libc-dev)(-[a-z0-9]+-cross)?$' || true; }
}

mkdir -p "$folder"
cp "$source/LICENSE" "$folder/accessvdb"
cp "$source/docs/licences.md" "$folder/licences.md"
if ! command -v dpkg-query >/dev/null; then
  echo "collect_licences: warning: no dpkg here, so the licence texts of the libraries are missing: do not pass them on" >&2
  exit 0
fi
packages=$(mktemp)
trap 'rm -f "$packages"' EXIT
{
  for library in "$@"; do
    package=$(package_of "$library")
    [[ -n $package ]] ||
      fail "no package owns $library, so its licence is unknown. Use the distribution's package of it."
    echo "$package"
  done
  [[ -z $headers_of ]] || header_packages
} >"$packages"
while read -r package; do
  text=$(text_of "$package")
  [[ -n $text ]] || fail "package '$package' has no licence text in ${texts[0]}/$package/copyright. Install it again: apt-get install --reinstall $package"
  cp -L "$text" "$folder/$package"
done < <(LC_ALL=C sort -u "$packages")
for common in $(grep -d skip -ohE '/usr/share/common-licenses/[A-Za-z0-9.-]*[A-Za-z0-9]' "$folder"/* | LC_ALL=C sort -u); do
  [[ -e $common ]] || continue
  mkdir -p "$folder/common-licenses"
  cp -L "$common" "$folder/common-licenses/"
done
