#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Builds this tree for 64-bit ARM, runs its unit and parity tests under qemu, and compares the files of the demo with
# those of an x86-64 build, byte by byte. Needs g++-aarch64-linux-gnu, mmdebstrap and qemu-aarch64, release 8 or later
# (Debian 13 has it; any that is first in PATH will do); no root, and no foreign packages on this machine.
#   arm64.sh FOLDER [X86_64_BIN] [MIRROR]     X86_64_BIN: folder of programs of the same commit; build/release/bin unless given
# FOLDER/sysroot has Debian 12's packages for arm64, FOLDER/build the programs, FOLDER/packages the tarball and the Debian
# packages; what is there is used again.
set -euo pipefail
fail() {
  echo "arm64: error: $*" >&2
  exit 1
}
source=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
(($# > 0)) || { echo "arm64: error: no folder given. usage: arm64.sh FOLDER [X86_64_BIN] [MIRROR]" >&2; exit 2; }
folder=$(realpath -m "$1") native=${2:-$source/build/release/bin} mirror=${3:-http://deb.debian.org/debian}
for need in "aarch64-linux-gnu-g++ g++-aarch64-linux-gnu" "mmdebstrap mmdebstrap" "cmake cmake" "ninja ninja-build"; do
  command -v "${need% *}" >/dev/null || fail "'${need% *}' is missing. On Debian and Ubuntu: apt install ${need#* }"
done
# Before 8 it kept a record of each page of addresses, and a map reserves 256 GiB of them: tests ran out of memory.
qemu=$(command -v qemu-aarch64 || command -v qemu-aarch64-static) || fail "qemu-aarch64 is missing. On Debian 13: apt install qemu-user"
release=$("$qemu" --version | sed -nE '1s/.* ([0-9]+)\..*/\1/p')
((release >= 8)) || fail "$qemu is release $release, and 8 or later is needed. Put a newer qemu-aarch64 first in PATH"
[[ -x $native/accessvdb && -x $native/make_sample_scans ]] ||
  fail "no programs of this machine to compare with in $native. Build them: ./tools/demo.sh"
sysroot=$folder/sysroot build=$folder/build
mkdir -p "$folder"

# Unpacked and not configured, so that nothing of it runs here.
if [[ ! -e $sysroot/.ready ]]; then
  rm -rf "$sysroot"
  packages=$("$source/tools/setup_debian.sh" --list --live --gis --lab |
    grep -vxE 'g\+\+|cmake|ninja-build|pkg-config' | paste -sd,)
  mode=unshare
  ((EUID != 0)) || mode=root
  mmdebstrap --mode=$mode --variant=extract --architectures=arm64 --include="libstdc++-12-dev,libgtest-dev,$packages" \
    bookworm "$sysroot" "$mirror" >"$folder/sysroot.log" 2>&1 || fail "no sysroot: $(tail -n 1 "$folder/sysroot.log")"
  # Links and CMake files that name the files of a running system.
  while IFS=' ' read -r link target; do
    [[ ! -e $sysroot$target ]] || ln -sfn "$(realpath -s --relative-to="$(dirname "$link")" "$sysroot$target")" "$link"
  done < <(find "$sysroot" -xtype l -lname '/*' -printf '%p %l\n')
  libraries=$sysroot/usr/lib/aarch64-linux-gnu
  for library in "$libraries"/{blas,lapack}/*.so*; do  # what update-alternatives would have linked
    [[ -e $libraries/${library##*/} ]] || ln -s "${library#"$libraries"/}" "$libraries/${library##*/}"
  done
  grep -rlE '[";: ]/usr/(lib|include|share|bin)' --include='*.cmake' "$sysroot/usr/lib" "$sysroot/usr/share" |
    xargs -r sed -i -E "/_realOrig|^ *#/!s#([\";: ])/usr/(lib|include|share|bin)#\\1$sysroot/usr/\\2#g"
  touch "$sysroot/.ready"
fi

launcher=$(command -v ccache || true)
export CCACHE_BASEDIR=$source
cmake -S "$source" -B "$build" -G Ninja --toolchain "$source/cmake/toolchains/aarch64-linux-gnu.cmake" \
  -DACCESSVDB_SYSROOT="$sysroot" -DCMAKE_BUILD_TYPE=Release -DCMAKE_CXX_COMPILER_LAUNCHER="$launcher" \
  -DACCESSVDB_CUDA=OFF -DACCESSVDB_PYTHON=OFF -DACCESSVDB_PCL=OFF -DACCESSVDB_OMPL=OFF -DACCESSVDB_OCTOMAP=OFF \
  -DACCESSVDB_LAB=ON -DACCESSVDB_DDS=ON -DACCESSVDB_BUILD_BENCHMARKS=OFF -DACCESSVDB_BUILD_TESTS=ON \
  -DACCESSVDB_TEST_OPTIONS=-O1 >"$folder/configure.log" 2>&1 || fail "CMake: $(grep -m1 -A2 'CMake Error' "$folder/configure.log" | tr '\n' ' ')"
ninja -C "$build" accessvdb accessvdb_shared accessvdb_cli accessvdb_lab make_sample_scans tests/unit/all tests/parity/all tests/platforms/all

# Programs that start others find no interpreter for them here, so that the tests are those of the library. Left out:
# that a command which does not exist is told as such. qemu makes vfork() a fork(), so that posix_spawn() never fails.
results=0
ctest --test-dir "$build" -L 'unit|parity|platforms' -E '^DecoderPipe.NamesWhatTheCommandDidWrong$' -j "$(nproc)" --timeout 3600 --output-on-failure || results=$?

demo() {  # demo FOLDER PREFIX... : the commands of tools/demo.sh
  local out=$1
  shift
  rm -rf "$out"
  mkdir -p "$out"
  "$@/make_sample_scans" --out "$out/scans" --frames 40 --rays 20000 --seed 1 --range-noise 0.01 >/dev/null 2>&1
  "$@/accessvdb" map --scans "$out/scans" --poses "$out/scans/poses.txt" --tool builtin:pruner --voxel 0.05 \
    --out "$out/field" >"$out/said" 2>&1 || fail "the demo failed: $(tail -n 1 "$out/said")"
}
demo "$folder/demo_x86_64" "$native"
demo "$folder/demo_arm64" "$qemu" -L "$sysroot" "$build/bin"
differ=0
for file in scans/poses.txt field/points.ply field/field.vdb field/field_points.vdb; do
  if cmp -s "$folder/demo_x86_64/$file" "$folder/demo_arm64/$file"; then
    echo "arm64: $file has the same bytes as on x86-64"
  else
    echo "arm64: $file differs from x86-64"
    differ=1
  fi
done
"$source/tools/make_packages.sh" "$folder/packages" --build "$build" --sysroot "$sysroot"
((results == 0)) || fail "tests failed, see above"
((differ == 0)) || fail "the demo's files differ"
