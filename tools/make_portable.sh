#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Packs programs and every shared library that they need, but for the C library and the GPU's driver, into one archive
# that runs on another Linux machine of the same processor without root and without installing anything.
#   make_portable.sh ARCHIVE.tar.xz FOLDER_OF_SCRIPTS PROGRAM...
# XZ_LEVEL: 6 unless set. In the archive: accessvdb-portable/run PROGRAM [arguments], programs/, libraries/, scripts/, README.
set -euo pipefail
archive=${1:?usage: make_portable.sh ARCHIVE.tar.xz FOLDER_OF_SCRIPTS PROGRAM...}
scripts=$2
shift 2
(($# > 0)) || { echo "make_portable: error: no programs given" >&2; exit 2; }

stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
root=$stage/accessvdb-portable
mkdir -p "$root/programs" "$root/libraries" "$root/scripts"
for program in "$@"; do
  [[ -x $program ]] || { echo "make_portable: error: no program $program" >&2; exit 1; }
  strip -o "$root/programs/$(basename "$program")" "$program"
done
cp "$scripts/gpu_suite.sh" "$root/scripts/"

# The C library and the loader belong to the machine that runs it; its driver's libraries stand on them.
of_the_machine='^(ld-linux.*|libc|libm|libdl|librt|libpthread|libresolv|libutil|libanl|libnsl|libcuda|libnvidia.*)\.so'
missing=$(ldd "$@" | grep 'not found' || true)
[[ -z $missing ]] || { echo "make_portable: error: $missing" >&2; exit 1; }
ldd "$@" | awk '$2 == "=>" && $3 ~ /^\// { print $3 }' | LC_ALL=C sort -u | while read -r library; do
  name=$(basename "$library")
  [[ $name =~ $of_the_machine ]] || cp -L "$library" "$root/libraries/$name"
done
strip --strip-unneeded "$root"/libraries/* 2>/dev/null || true

cat >"$root/run" <<'END'
#!/bin/sh
# run PROGRAM [arguments]: a program of this folder with the libraries of this folder. Without a name: accessvdb.
here=$(cd "$(dirname "$0")" && pwd) || exit 70
program=accessvdb
if [ -n "${1:-}" ] && [ -f "$here/programs/$1" ]; then
  program=$1
  shift
fi
LD_LIBRARY_PATH=$here/libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} exec "$here/programs/$program" "$@"
END
chmod +x "$root/run"
glibc=$(ldd --version | sed -n '1s/.* //p')
cat >"$root/README" <<END
AccessVDB, $(uname -m) Linux with glibc $glibc or later. Nothing to install: ./run map --help
A GPU is used where an NVIDIA driver is installed. scripts/gpu_suite.sh checks and measures it.
END

mkdir -p "$(dirname "$archive")"
tar -C "$stage" --sort=name --owner=0 --group=0 --numeric-owner --mtime='2000-01-01 UTC' -c accessvdb-portable |
  xz -T0 "-${XZ_LEVEL:-6}" >"$archive.tmp"
mv "$archive.tmp" "$archive"
bytes=$(stat -c %s "$archive")
echo "$archive: $((bytes / 1048576)) MiB, $(find "$root/libraries" -type f | wc -l) libraries"
if ((bytes >= 64 * 1048576)); then
  echo "make_portable: error: the archive is larger than 64 MiB" >&2
  exit 1
fi
