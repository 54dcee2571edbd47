#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# find_package refuses what it cannot provide, and says why.
set -euo pipefail
folder=$WORK/refusals
rm -rf "$folder"
mkdir -p "$folder"
bad=0

# refuse NAME REQUEST TEXT [OPTION...]: REQUEST fails with a message that contains TEXT.
refuse() {
  local name=$1 request=$2 text=$3
  shift 3
  mkdir -p "$folder/$name"
  printf 'cmake_minimum_required(VERSION 3.24)\nproject(refused LANGUAGES CXX)\nfind_package(AccessVDB %s)\n' "$request" \
    >"$folder/$name/CMakeLists.txt"
  if "$CMAKE" -G "$GENERATOR" -S "$folder/$name" -B "$folder/$name/build" "-DCMAKE_PREFIX_PATH=$WORK/moved" \
    "-DCMAKE_CXX_COMPILER=$CXX" "$@" >"$folder/$name/log" 2>&1; then
    echo "$name: was not refused"
    bad=1
  elif ! tr -s ' \n' ' ' <"$folder/$name/log" | grep -qF "$text"; then
    echo "$name: the message lacks '$text':"
    cat "$folder/$name/log"
    bad=1
  fi
}

refuse unknown_component "CONFIG REQUIRED COMPONENTS telepathy" "no component telepathy; it has: core;io"
refuse both_kinds "CONFIG REQUIRED COMPONENTS static shared" "static and shared, not for both"
refuse newer_version "9.0 CONFIG REQUIRED" "version: $VERSION"
refuse next_minor "0.0 CONFIG REQUIRED" "version: $VERSION"
refuse missing_dependency "CONFIG REQUIRED COMPONENTS static" "apt install libassimp-dev" -DCMAKE_DISABLE_FIND_PACKAGE_assimp=ON
# Another OpenVDB than the one that it was built with.
mkdir -p "$folder/other/lib/cmake/OpenVDB"
printf 'set(OpenVDB_FOUND TRUE)\nset(OpenVDB_VERSION 12.1.0)\n' >"$folder/other/lib/cmake/OpenVDB/FindOpenVDB.cmake"
refuse other_openvdb "CONFIG REQUIRED" "and found OpenVDB 12.1.0. Name the former in CMAKE_PREFIX_PATH" \
  "-DCMAKE_PREFIX_PATH=$WORK/moved;$folder/other"
exit $bad
