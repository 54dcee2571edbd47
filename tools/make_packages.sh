#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Builds the programs without a GPU and makes what can be downloaded: the three Debian packages, and a tarball that
# runs without installing anything. Prints each file with its size.
#   make_packages.sh [OUT] [--limit MB] [--glibc VERSION] [--build BUILD] [--sysroot DIR] [-DNAME=VALUE...]
# OUT: out/packages unless given; the tarball: at most 40 MB, and nothing in it that needs a newer C library than --glibc
# (2.35 unless given). Only whole files reach OUT. -D goes to CMake. What the tarball contains is said in docs/licences.md.
# --build packs what is built there, instead of building. For another processor: --build with a cross build, and --sysroot
# with the root that it was linked against, of the same release as this machine.
set -euo pipefail
fail() {
  echo "make_packages: error: $*" >&2
  exit 1
}
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
usage="Use: make_packages.sh [OUT] [--limit MB] [--glibc VERSION] [--build BUILD] [--sysroot DIR] [-DNAME=VALUE...]"
out=$source/out/packages limit=40 glibc=2.35 build='' sysroot='' settings=()
while (($# > 0)); do
  case $1 in
    --limit)
      [[ ${2:-} =~ ^[0-9]+$ ]] || fail "--limit needs a number of megabytes"
      limit=$2
      shift
      ;;
    --glibc)
      [[ ${2:-} =~ ^[0-9]+\.[0-9]+$ ]] || fail "--glibc needs a version such as 2.35"
      glibc=$2
      shift
      ;;
    --build | --sysroot)
      [[ -d ${2:-} ]] || fail "$1 needs a folder"
      if [[ $1 == --build ]]; then build=$(realpath "$2"); else sysroot=$(realpath "$2"); fi
      shift
      ;;
    -D*) settings+=("$1") ;;
    -*) fail "unknown option '$1'. $usage" ;;
    *) out=$(realpath -m "$1") ;;
  esac
  shift
done
for need in "cpack cmake" "cmake cmake" "ninja ninja-build" "dpkg-deb dpkg" "dpkg-query dpkg" "dpkg-shlibdeps dpkg-dev" \
  "strip binutils" "xz xz-utils"; do
  command -v "${need% *}" >/dev/null ||
    fail "'${need% *}' is missing. Packages are made on Debian or Ubuntu: apt install ${need#* }"
done

# Scans, meshes and fields are large, and may belong to others.
refuse_data() {  # refuse_data FILE...
  local file data
  data=$(for file in "$@"; do
    case $file in *.deb) dpkg-deb --fsys-tarfile "$file" | tar -t ;; *) tar -tJf "$file" ;; esac
  done | grep -iE '\.(pcd|ply|las|laz|bin|bag|vdb|nvdb|obj|stl|csv|png|json)$|(^|/)(tests?|shared|out)/' || true)
  [[ -z $data ]] || fail "data must not go into the packages. Take it out of the install rules: ${data//$'\n'/ }"
}

if [[ -n $build ]]; then
  [[ -e $build/CPackConfig.cmake ]] || fail "$build is no build of AccessVDB with its install rules"
else
  build=$source/build/packages
  "$source/tools/build_preset.sh" packages ${settings[@]+"${settings[@]}"} accessvdb accessvdb_cli accessvdb_lab accessvdb_shared make_sample_scans >&2 ||
    fail "the build failed, see above"
fi

mkdir -p "$(dirname "$out")"
stage=$(mktemp -d "$out.XXXXXX")
trap 'rm -rf "$stage"' EXIT
mkdir "$stage/work" "$stage/done"
machine=$(uname -m) foreign=()
if [[ -n $sysroot ]]; then
  case $(LC_ALL=C readelf -h "$build/bin/accessvdb" | sed -n 's/^ *Machine: *//p') in
    *X86-64) machine=x86_64 architecture=amd64 ;;
    AArch64) machine=aarch64 architecture=arm64 ;;
    *) fail "$build/bin/accessvdb is for a processor that is not known here" ;;
  esac
  # dpkg-shlibdeps cannot read packages that are not installed. Those of one release have the same names on each processor.
  depends_of() {  # depends_of PROGRAM
    local library
    echo "libc6 (>= $("$source/tools/platforms/glibc_needed.sh" "$1" | cut -f 2))"
    while read -r library; do
      { dpkg-query -S "/usr/lib/$(uname -m)-linux-gnu/$library" || dpkg-query -S "/lib/$(uname -m)-linux-gnu/$library"; } 2>/dev/null |
        sed -n '/^diversion/d; s/[:,].*//p' | head -n 1 | grep . || fail "no package here has $library, which $1 needs"
    done < <(LC_ALL=C readelf -d "$1" | sed -n 's/.*(NEEDED).*\[\(.*\)\]$/\1/p' | grep -vE '^(lib(c|m)|ld-linux.*)\.so' | LC_ALL=C sort -u)
  }
  runtime=$(depends_of "$build/bin/accessvdb" | LC_ALL=C sort -u | paste -sd , | sed 's/,/, /g')
  lab=$(depends_of "$build/bin/accessvdb-lab" | LC_ALL=C sort -u | paste -sd , | sed 's/,/, /g')
  version=$(sed -n 's/^set(CPACK_PACKAGE_VERSION "\(.*\)")/\1/p' "$build/CPackConfig.cmake")
  foreign=(-D "CPACK_DEBIAN_PACKAGE_ARCHITECTURE=$architecture"
    -D CPACK_DEBIAN_RUNTIME_PACKAGE_SHLIBDEPS=OFF -D "CPACK_DEBIAN_RUNTIME_PACKAGE_DEPENDS=$runtime"
    -D CPACK_DEBIAN_LAB_PACKAGE_SHLIBDEPS=OFF -D "CPACK_DEBIAN_LAB_PACKAGE_DEPENDS=accessvdb (= $version), $lab")
fi
cpack --config "$build/CPackConfig.cmake" -G DEB -B "$stage/work" ${foreign[@]+"${foreign[@]}"} >"$stage/log" 2>&1 ||
  { cat "$stage/log" >&2; fail "cpack failed, see above"; }
mv "$stage"/work/*.deb "$stage/done/"
refuse_data "$stage"/done/*

version=$(sed -n 's/^set(CPACK_PACKAGE_VERSION "\(.*\)")/\1/p' "$build/CPackConfig.cmake")
name=accessvdb-$version-linux-$machine
"$source/tools/make_portable.sh" --name "$name" --limit "$limit" --glibc "$glibc" ${sysroot:+--sysroot "$sysroot"} --headers-of "$build" "$stage/done/$name.tar.xz" - \
  "$build/bin/accessvdb" "$build/bin/accessvdb-lab" "$build/bin/make_sample_scans" >"$stage/log" || fail "no tarball, see above"

refuse_data "$stage/done/$name.tar.xz"

mkdir -p "$out"
for file in "$stage"/done/*; do
  chmod 644 "$file"
  mv -f "$file" "$out/"
  awk -v file="$out/${file##*/}" -v bytes="$(stat -c %s "$out/${file##*/}")" 'BEGIN { printf "%s: %.1f MB\n", file, bytes / 1e6 }'
done
