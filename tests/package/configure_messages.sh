#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# What CMake says about options with unknown values and about packages that are asked for but missing.
set -euo pipefail
work=$WORK/configure_messages
rm -rf "$work"
mkdir -p "$work/bin"
# A machine without nvcc: only the tools that CMake needs are on the path.
for tool in "$CC" "$CXX" as ld ar ranlib make ninja pkg-config sh sed uname; do
  path=$(command -v "$tool") && ln -sf "$path" "$work/bin/$(basename "$tool")"
done

hidden=/usr/local/cuda/bin$(type -ap nvcc | sed 's,/[^/]*$,,; s,^,;,' | tr -d '\n')

bad=0
configure() {  # configure CODE TEXT ARGUMENT...
  local code=0
  rm -rf "$work/build"
  env -u CUDACXX -u CUDA_PATH PATH="$work/bin" "$CMAKE" -S "$SOURCE" -B "$work/build" -G "$GENERATOR" \
    -DCMAKE_C_COMPILER="$CC" -DCMAKE_CXX_COMPILER="$CXX" "-DCMAKE_IGNORE_PATH=$hidden" \
    -DACCESSVDB_BUILD_TESTS=OFF -DACCESSVDB_BUILD_BENCHMARKS=OFF -DACCESSVDB_PYTHON=OFF "${@:3}" >"$work/out" 2>&1 || code=$?
  # Joined, as CMake wraps long messages.
  if (((code == 0) != ($1 == 0))) || ! tr -s ' \n' ' ' <"$work/out" | grep -qF "$2"; then
    echo "exit code $code, expected $1 and '$2' from: ${*:3}"
    tail -n 20 "$work/out"
    bad=1
  fi
}

# OpenVDB and NanoVDB of releases that nobody has tried: one line, before anything is compiled.
release() {  # release VERSION MAJOR MINOR: a folder with a Find module of that OpenVDB and a header of that NanoVDB
  mkdir -p "$work/$1/lib/cmake/OpenVDB" "$work/$1/include/nanovdb"
  printf 'set(OpenVDB_FOUND TRUE)\nset(OpenVDB_VERSION %s)\n' "$1" >"$work/$1/lib/cmake/OpenVDB/FindOpenVDB.cmake"
  printf '#define NANOVDB_%s_VERSION_NUMBER %s // of the file\n' MAJOR "$2" MINOR "$3" PATCH 0 >"$work/$1/include/nanovdb/NanoVDB.h"
}
for openvdb in 9.1.0 14.0.0; do
  release $openvdb 32 9
  configure 1 "AccessVDB needs OpenVDB 10 to 13; this is $openvdb. Name another one: -DCMAKE_PREFIX_PATH=PREFIX" \
    -DCMAKE_PREFIX_PATH="$work/$openvdb" -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
done
for nanovdb in 32.3 33.0; do
  release 10.0.$nanovdb "${nanovdb%.*}" "${nanovdb#*.}"
  configure 1 "AccessVDB needs NanoVDB 32.4 or a later 32.x, which come with OpenVDB 10 to 13; $work/10.0.$nanovdb/include/nanovdb is $nanovdb" \
    -DCMAKE_PREFIX_PATH="$work/10.0.$nanovdb" -DACCESSVDB_NANOVDB_INCLUDE_DIR="$work/10.0.$nanovdb/include" -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
done
configure 1 "ACCESSVDB_PCL is 'MAYBE'. Use AUTO (if PCL is found), ON or OFF." -DACCESSVDB_PCL=MAYBE -DACCESSVDB_CUDA=OFF
configure 1 "ACCESSVDB_PCL is ON, but PCL (common, io, filters) was not found. On Debian and Ubuntu: apt install libpcl-dev" \
  -DACCESSVDB_PCL=ON -DCMAKE_DISABLE_FIND_PACKAGE_PCL=ON -DACCESSVDB_CUDA=OFF
configure 1 "ACCESSVDB_LAB is 'MAYBE'. Use AUTO (if Embree and Qhull are found), ON or OFF." -DACCESSVDB_LAB=MAYBE -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 1 "ACCESSVDB_LAB is ON, but Embree 3 or 4 was not found. On Debian and Ubuntu: apt install libembree-dev" \
  -DACCESSVDB_LAB=ON -DCMAKE_DISABLE_FIND_PACKAGE_embree=ON -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 0 "no lab (accessvdb-lab): Qhull was not found. On Debian and Ubuntu: apt install libqhull-dev" \
  -DCMAKE_DISABLE_FIND_PACKAGE_Qhull=ON -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 1 "The tests need the lab." -DACCESSVDB_BUILD_TESTS=ON -DACCESSVDB_LAB=OFF -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 1 "ACCESSVDB_DDS is 'MAYBE'. Use AUTO (if Fast DDS is found), ON or OFF." -DACCESSVDB_DDS=MAYBE -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 1 "ACCESSVDB_DDS is ON, but Fast DDS 2.6 to 3 was not found. On Debian and Ubuntu: apt install libfastrtps-dev" \
  -DACCESSVDB_DDS=ON -DCMAKE_DISABLE_FIND_PACKAGE_fastrtps=ON -DCMAKE_DISABLE_FIND_PACKAGE_fastdds=ON -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 1 "ACCESSVDB_GDAL is ON, but gdal.h was not found. On Debian and Ubuntu: apt install libgdal-dev" \
  -DACCESSVDB_GDAL=ON -DCMAKE_IGNORE_PATH=/usr/include/gdal -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 1 "ACCESSVDB_OMPL is 'MAYBE'. Use AUTO (if OMPL is found), ON or OFF." -DACCESSVDB_OMPL=MAYBE -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 1 "ACCESSVDB_OMPL is ON, but ompl/base/StateSpace.h or its library was not found. On Debian and Ubuntu: apt install libompl-dev" \
  -DACCESSVDB_OMPL=ON -DCMAKE_IGNORE_PATH=/usr/include/ompl-1.5 -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF
configure 1 "ACCESSVDB_CUDA is 'MAYBE'. Use AUTO (if nvcc is found), ON or OFF." -DACCESSVDB_CUDA=MAYBE -DACCESSVDB_PCL=OFF
configure 1 "ACCESSVDB_PYTHON is 'MAYBE'. Use AUTO" -DACCESSVDB_CUDA=OFF -DACCESSVDB_PCL=OFF -DACCESSVDB_PYTHON=MAYBE
configure 1 "(nvcc and its static runtime) was not found. Install NVIDIA's CUDA toolkit" -DACCESSVDB_CUDA=ON -DACCESSVDB_PCL=OFF
configure 0 "no CUDA backend in this build; scoring runs on the CPU" -DACCESSVDB_CUDA=AUTO -DACCESSVDB_PCL=OFF
((bad == 0)) && echo "every message says what to do"
