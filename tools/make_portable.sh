#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Packs programs and all shared libraries that they need, except the C library and the GPU's driver, into one archive
# that runs on another Linux machine with the same type of processor, without root and without installing anything.
#   make_portable.sh [--name FOLDER] [--limit MB] [--glibc VERSION] [--sysroot DIR] [--headers-of BUILD]
#                    ARCHIVE.tar.xz FOLDER_OF_SCRIPTS|- PROGRAM...
# In the archive: FOLDER/bin/PROGRAM and FOLDER/run PROGRAM [arguments], programs/, libraries/, runtime/, scripts/,
# README, and licences/: the texts for each library in it and, with --headers-of, for the headers that this Ninja build
# compiled in. XZ_LEVEL: 6 unless set. Nothing is written if the archive would be larger than --limit, or if anything in
# programs/ or libraries/ needs a newer C library than --glibc (2.35 unless given). --sysroot: the root that programs for
# another processor were linked against, with their libraries and the licence texts in usr/share/doc.
set -euo pipefail
fail() {
  echo "make_portable: error: $*" >&2
  exit 1
}
usage="usage: make_portable.sh [--name FOLDER] [--limit MB] [--glibc VERSION] [--sysroot DIR] [--headers-of BUILD] ARCHIVE.tar.xz FOLDER_OF_SCRIPTS|- PROGRAM..."
name=accessvdb-portable limit=64 glibc_limit=2.35 sysroot='' headers_of=
while [[ ${1:-} == --* ]]; do
  case $1 in
    --name) name=${2:?$usage} ;;
    --limit) limit=${2:?$usage} ;;
    --glibc) glibc_limit=${2:?$usage} ;;
    --sysroot) sysroot=$(realpath -e "${2:?$usage}") || fail "no folder $2" ;;
    --headers-of) headers_of=${2:?$usage} ;;
    *) fail "unknown option $1. $usage" ;;
  esac
  shift 2
done
(($# > 2)) || { echo "make_portable: error: no programs given. $usage" >&2; exit 2; }
[[ $glibc_limit =~ ^[0-9]+\.[0-9]+$ ]] || fail "--glibc needs a version such as 2.35"
archive=$1 scripts=$2
shift 2
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

# Programs for another processor cannot be asked for their libraries by running them, as ldd does.
machine_of() {  # machine_of FILE: as uname -m names it
  case $(LC_ALL=C readelf -h "$1" 2>/dev/null | sed -n 's/^ *Machine: *//p') in
    *X86-64) echo x86_64 ;;
    AArch64) echo aarch64 ;;
    RISC-V) echo riscv64 ;;
    *) return 1 ;;
  esac
}
host_triplet=$(uname -m)-linux-gnu
machine=$(machine_of "$1") || fail "$1 is no program for a processor that is known here"
triplet=$machine-linux-gnu
strip=strip
if [[ $triplet != "$host_triplet" ]]; then
  [[ -n $sysroot ]] || fail "$1 is for $machine: say with --sysroot where its libraries are"
  strip=$triplet-strip
  command -v "$strip" >/dev/null || fail "'$strip' is missing: apt install binutils-${triplet//_/-}"
fi

stage=$(mktemp -d)
trap 'rm -rf "$stage" "$archive.tmp"' EXIT
root=$stage/$name
mkdir -p "$root/bin" "$root/programs" "$root/libraries" "$root/runtime" "$root/licences"
for program in "$@"; do
  [[ -x $program ]] || fail "no program $program"
  [[ $(machine_of "$program" || true) == "$machine" ]] || fail "$program is not for $machine, as $1 is"
  "$strip" -o "$root/programs/$(basename "$program")" "$program"
  ln -s ../run "$root/bin/$(basename "$program")"
done
if [[ $scripts != - ]]; then
  mkdir "$root/scripts"
  cp "$scripts/gpu_suite.sh" "$root/scripts/"
fi

inside() {  # inside FILE: FILE with its links followed in the sysroot, where they may begin with /
  local file=$1 target hops=0
  while [[ -L $file ]] && ((++hops < 40)); do
    target=$(readlink "$file")
    case $target in
      "$sysroot"/*) file=$target ;;
      /*) file=$sysroot$target ;;
      *) file=$(dirname "$file")/$target ;;
    esac
  done
  realpath -e "$file"
}
walked_libraries() {  # walked_libraries PROGRAM...: paths in the sysroot, in the loader's order, without running anything
  local queue=("$@") seen=" " file needed folder found
  local folders=("$sysroot/usr/lib/$triplet" "$sysroot/lib/$triplet" "$sysroot/usr/lib64" "$sysroot/lib64" "$sysroot/usr/lib" "$sysroot/lib")
  while read -r folder; do folders+=("$sysroot$folder"); done < <(cat "$sysroot"/etc/ld.so.conf.d/*.conf 2>/dev/null | grep '^/')
  while ((${#queue[@]} > 0)); do
    file=${queue[0]}
    queue=("${queue[@]:1}")
    while read -r needed; do
      [[ $seen != *" $needed "* ]] || continue
      seen+="$needed "
      [[ ! $needed =~ $of_the_machine ]] || continue
      found=
      for folder in "${folders[@]}"; do
        [[ -e $folder/$needed || -L $folder/$needed ]] || continue
        found=$folder/$needed
        break
      done
      [[ -n $found ]] && inside "$found" >/dev/null || fail "$needed, which $(basename "$file") needs, is not in $sysroot"
      echo "$found"
      queue+=("$(inside "$found")")
    done < <(LC_ALL=C readelf -d "$file" | sed -n 's/.*(NEEDED).*\[\(.*\)\]$/\1/p')
  done
}

# The C library and the loader come from the machine that runs it; its driver's libraries depend on them.
of_the_machine='^(ld-linux.*|libc|libm|libdl|librt|libpthread|libresolv|libutil|libanl|libnsl|libcuda|libnvidia.*)\.so'
# Every machine has GCC's runtime, most a newer one than ours, which what a program loads there may need (GDAL). Ours is
# for those whose own is too old.
of_gcc='^(libstdc\+\+|libgcc_s)\.so'
if [[ -n $sysroot ]]; then
  walked_libraries "$@" >"$stage/found" || exit 1
else
  missing=$(ldd "$@" | grep 'not found' || true)
  [[ -z $missing ]] || fail "$missing"
  ldd "$@" | awk '$2 == "=>" && $3 ~ /^\// { print $3 }' >"$stage/found"
fi
shipped=()
while read -r library; do
  file=$(basename "$library")
  [[ ! $file =~ $of_the_machine ]] || continue
  real=$(inside "$library")
  folder=libraries
  [[ ! $file =~ $of_gcc ]] || folder=runtime
  cp -L "$real" "$root/$folder/$file"
  shipped+=("$real")
done < <(LC_ALL=C sort -u "$stage/found")
"$strip" --strip-unneeded "$root"/libraries/* "$root"/runtime/* 2>/dev/null || true

# What the archive asks of the machine is read from what is in it.
needs=$source/tools/platforms/glibc_needed.sh
highest() { cut -f "$1" | { grep -v '^-$' || echo 0; } | LC_ALL=C sort -V | tail -n 1; }
(cd "$root" && "$needs" --limit "$glibc_limit" programs/* $(compgen -G 'libraries/*')) >"$stage/needs" || fail "nothing is packed, see above"
glibc=$(highest 2 <"$stage/needs")
(cd "$root" && files=$(compgen -G 'runtime/*') && "$needs" $files) >"$stage/needs_runtime" || true
runtime_glibc=$(highest 2 <"$stage/needs_runtime")

"$source/tools/collect_licences.sh" "$root/licences" ${sysroot:+--sysroot "$sysroot" --triplet "$triplet"} \
  ${headers_of:+--headers-of "$headers_of"} "${shipped[@]}" || fail "no licences, see above"
chmod -R u+rwX,go+rX,go-w "$root"

glibcxx=$(highest 4 <"$stage/needs")
sed "s/@MACHINE@/$machine/; s/@GLIBC@/$glibc/; s/@GLIBCXX@/$glibcxx/; s/@RUNTIME_GLIBC@/$runtime_glibc/" >"$root/run" <<'END'
#!/bin/sh
# run PROGRAM [arguments]: a program of this folder with the libraries of this folder. Without a name: accessvdb. Each
# name in bin/ is a link to this script and runs the program of that name.
machine=@MACHINE@ glibc=@GLIBC@ glibcxx=@GLIBCXX@ runtime_glibc=@RUNTIME_GLIBC@
called=$(basename "$0")
here=$(cd "$(dirname "$(readlink -f "$0")")" && pwd) || exit 70
program=accessvdb
if [ -f "$here/programs/$called" ]; then
  program=$called
elif [ -n "${1:-}" ] && [ -f "$here/programs/$1" ]; then
  program=$1
  shift
fi
file=$here/programs/$program

# The loader's own list says, before the program starts, what this machine lacks.
refuse() {
  echo "$program: error[$1]" "$2" >&2
  exit 5
}
advice="Use a newer distribution or an image of one, or compile AccessVDB on this machine."
list() {  # list FOLDERS
  LD_TRACE_LOADED_OBJECTS=1 LD_LIBRARY_PATH=$1${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} "$file" 2>&1
}
libraries=$here/libraries
found=$(list "$libraries") ||
  refuse start.machine "$(uname -m): this is a program for $machine Linux with glibc $glibc or later, and it does not start here. Take the archive for this machine, or compile AccessVDB on it."
case $found in
  *"version \`GLIBC_"*"not found"*)
    own=$(getconf GNU_LIBC_VERSION 2>/dev/null)
    refuse start.glibc "this machine: its C library (${own:-glibc}) is older than glibc $glibc, which is needed. $advice" ;;
  *"not found"*)
    # Its C++ runtime is older than the one in runtime/, or there is none.
    libraries=$here/libraries:$here/runtime
    found=$(list "$libraries") ;;
esac
case $found in
  *"version \`GLIBC_"*"not found"*)
    refuse start.runtime "this machine: its libstdc++ is too old, and the one in runtime/ needs glibc $runtime_glibc. Install a libstdc++6 with GLIBCXX_$glibcxx. $advice" ;;
  *"not found"*)
    refuse start.library "$(echo "$found" | grep 'not found' | head -n 1 | sed 's/^[[:space:]]*//'): a library is missing here. Unpack the archive again. $advice" ;;
esac
LD_LIBRARY_PATH=$libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH} exec "$file" "$@"
END
chmod +x "$root/run"
{
  echo "AccessVDB for $machine Linux with glibc $glibc or later. There is nothing to install:"
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
  if [[ -s $stage/needs_runtime ]]; then
    echo "runtime/ has GCC's runtime for machines whose own has no GLIBCXX_$glibcxx; it needs glibc $runtime_glibc."
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
awk -v file="$archive" -v bytes="$bytes" -v libraries="$(find "$root/libraries" "$root/runtime" -type f | wc -l)" -v glibc="$glibc" \
  'BEGIN { printf "%s: %.1f MB, %d libraries, glibc %s\n", file, bytes / 1e6, libraries, glibc }'
