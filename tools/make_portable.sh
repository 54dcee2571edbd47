#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Packs programs and all shared libraries that they need, except the C library and the GPU's driver, into one archive
# that runs on another Linux machine with the same type of processor, without root and without installing anything.
#   make_portable.sh [--name FOLDER] [--limit MB] [--headers-of BUILD] ARCHIVE.tar.xz FOLDER_OF_SCRIPTS|- PROGRAM...
# In the archive: FOLDER/bin/PROGRAM and FOLDER/run PROGRAM [arguments], programs/, libraries/, scripts/, README, and
# licences/: the texts for each library in it and, with --headers-of, for the headers that this Ninja build compiled in.
# XZ_LEVEL: 6 unless set. Nothing is written if the archive would be larger than --limit.
set -euo pipefail
fail() {
  echo "make_portable: error: $*" >&2
  exit 1
}
usage="usage: make_portable.sh [--name FOLDER] [--limit MB] [--headers-of BUILD] ARCHIVE.tar.xz FOLDER_OF_SCRIPTS|- PROGRAM..."
name=accessvdb-portable limit=64 headers_of=
while [[ ${1:-} == --* ]]; do
  case $1 in
    --name) name=${2:?$usage} ;;
    --limit) limit=${2:?$usage} ;;
    --headers-of) headers_of=${2:?$usage} ;;
    *) fail "unknown option $1. $usage" ;;
  esac
  shift 2
done
(($# > 2)) || { echo "make_portable: error: no programs given. $usage" >&2; exit 2; }
archive=$1 scripts=$2
shift 2
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

stage=$(mktemp -d)
trap 'rm -rf "$stage" "$archive.tmp"' EXIT
root=$stage/$name
mkdir -p "$root/bin" "$root/programs" "$root/libraries" "$root/licences"
for program in "$@"; do
  [[ -x $program ]] || fail "no program $program"
  strip -o "$root/programs/$(basename "$program")" "$program"
  ln -s ../run "$root/bin/$(basename "$program")"
done
if [[ $scripts != - ]]; then
  mkdir "$root/scripts"
  cp "$scripts/gpu_suite.sh" "$root/scripts/"
fi

# The C library and the loader come from the machine that runs it; its driver's libraries depend on them.
of_the_machine='^(ld-linux.*|libc|libm|libdl|librt|libpthread|libresolv|libutil|libanl|libnsl|libcuda|libnvidia.*)\.so'
missing=$(ldd "$@" | grep 'not found' || true)
[[ -z $missing ]] || fail "$missing"
shipped=()
while read -r library; do
  file=$(basename "$library")
  [[ ! $file =~ $of_the_machine ]] || continue
  cp -L "$library" "$root/libraries/$file"
  shipped+=("$(readlink -f "$library")")
done < <(ldd "$@" | awk '$2 == "=>" && $3 ~ /^\// { print $3 }' | LC_ALL=C sort -u)
strip --strip-unneeded "$root"/libraries/* 2>/dev/null || true

# The licence text of each package, and the common texts that it refers to. Headers of the C library are left out: they
# describe the machine's own library.
package_of() {  # package_of FILE: if /lib is a link to /usr/lib, dpkg may know either name
  local other=/usr$1
  [[ $1 != /usr/* ]] || other=${1#/usr}
  { dpkg-query -S "$1" || dpkg-query -S "$other"; } 2>/dev/null | sed -n '/^diversion/d; s/[:,].*//p' | head -n 1
}
text_of() {  # text_of PACKAGE: its own, or that of another package from the same source (Ubuntu's libssl-dev has a dangling link)
  local other from
  from=$(dpkg-query -W -f '${source:Package}\n' "$1" | head -n 1)
  for other in "$1" $(dpkg-query -W -f '${source:Package} ${Package}\n' | awk -v from="$from" '$1 == from { print $2 }'); do
    [[ ! -s /usr/share/doc/$other/copyright ]] || { echo "/usr/share/doc/$other/copyright"; return; }
  done
}
cp "$source/LICENSE" "$root/licences/accessvdb"
cp "$source/docs/licences.md" "$root/licences/licences.md"
if command -v dpkg-query >/dev/null; then
  {
    for library in "${shipped[@]}"; do
      package=$(package_of "$library")
      [[ -n $package ]] ||
        fail "no package owns $library, so its licence is unknown. Use the distribution's package of it."
      echo "$package"
    done
    if [[ -n $headers_of ]]; then
      headers=$(ninja -C "$headers_of" -t deps | sed -n 's|^ \+\(/usr/.*\)|\1|p' | LC_ALL=C sort -u)
      [[ -n $headers ]] || fail "$headers_of is not a Ninja build, or nothing is built there"
      xargs readlink -f <<<"$headers" | xargs dpkg-query -S 2>/dev/null | sed '/^diversion/d; s/[:,].*//' |
        grep -vxE 'libc6-dev|linux-libc-dev' || true
    fi
  } >"$stage/packages"
  while read -r package; do
    text=$(text_of "$package")
    [[ -n $text ]] || fail "package '$package' has no licence text in /usr/share/doc/$package/copyright. Install it again: apt-get install --reinstall $package"
    cp -L "$text" "$root/licences/$package"
  done < <(LC_ALL=C sort -u "$stage/packages")
  for common in $(grep -ohE '/usr/share/common-licenses/[A-Za-z0-9.-]*[A-Za-z0-9]' "$root"/licences/* | LC_ALL=C sort -u); do
    [[ -e $common ]] || continue
    mkdir -p "$root/licences/common-licenses"
    cp -L "$common" "$root/licences/common-licenses/"
  done
else
  echo "make_portable: warning: no dpkg here, so the licence texts of the libraries are missing: do not pass the archive on" >&2
fi
chmod -R u+rwX,go+rX,go-w "$root"

cat >"$root/run" <<'END'
#!/bin/sh
# run PROGRAM [arguments]: a program of this folder with the libraries of this folder. Without a name: accessvdb. Each
# name in bin/ is a link to this script and runs the program of that name.
called=$(basename "$0")
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd) || exit 70
program=accessvdb
if [ -f "$here/programs/$called" ]; then
  program=$called
elif [ -n "${1:-}" ] && [ -f "$here/programs/$1" ]; then
  program=$1
  shift
fi
LD_LIBRARY_PATH=$here/libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} exec "$here/programs/$program" "$@"
END
chmod +x "$root/run"
glibc=$(ldd --version | sed -n '1s/.* //p')
{
  echo "AccessVDB for $(uname -m) Linux with glibc $glibc or later. There is nothing to install:"
  echo
  if [[ -e $root/programs/make_sample_scans ]]; then
    echo "  bin/make_sample_scans --out scans --range-noise 0.01"
    echo "  bin/accessvdb map --scans scans --poses scans/poses.txt --tool builtin:pruner --voxel 0.05 --out field"
  else
    echo "  bin/accessvdb map --help"
  fi
  echo
  if [[ $scripts != - ]]; then
    echo "A GPU is used where an NVIDIA driver is installed. scripts/gpu_suite.sh checks and measures it."
  fi
  echo "The licences of AccessVDB and of everything else in this folder are in licences/."
} >"$root/README"

mkdir -p "$(dirname "$archive")"
tar -C "$stage" --sort=name --owner=0 --group=0 --numeric-owner --mtime='2000-01-01 UTC' -c "$name" |
  xz -T0 "-${XZ_LEVEL:-6}" >"$archive.tmp"
bytes=$(stat -c %s "$archive.tmp")
((bytes <= limit * 1000000)) ||
  fail "the archive has $bytes bytes, more than $limit MB. Its largest files: $(cd "$root" && find . -type f -printf '%s %P\n' |
    sort -rn | awk 'NR <= 3 { printf "%s%s (%.0f MB)", (NR > 1 ? ", " : ""), $2, $1 / 1e6 }'). Leave out a library, or raise --limit."
mv "$archive.tmp" "$archive"
awk -v file="$archive" -v bytes="$bytes" -v libraries="$(find "$root/libraries" -type f | wc -l)" \
  'BEGIN { printf "%s: %.1f MB, %d libraries\n", file, bytes / 1e6, libraries }'
