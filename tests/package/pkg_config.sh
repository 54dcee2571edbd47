#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Consumers with pkg-config: C++ against both kinds of library, and C.
set -euo pipefail
command -v pkg-config >/dev/null || { echo "skipped: pkg-config is missing"; exit 77; }
out=$WORK/pkg_config
rm -rf "$out"
mkdir -p "$out"
read -ra launcher <<<"${LAUNCHER/;/ }"

export PKG_CONFIG_PATH=$WORK/moved/$LIBDIR/pkgconfig
[[ $(pkg-config --modversion accessvdb) == "$VERSION" ]]
# shellcheck disable=SC2046  # flags are words
"${launcher[@]}" "$CXX" -std=c++20 -O1 -c "$SOURCE/tests/package/consumer/main.cpp" -o "$out/main.o" $(pkg-config --cflags accessvdb)
# shellcheck disable=SC2046
"$CXX" "$out/main.o" -o "$out/consumer" $(pkg-config --libs accessvdb)
LD_LIBRARY_PATH=$WORK/moved/$LIBDIR "$out/consumer" "$out/field"

# The static library: the same line with --static, in an install without a shared one that would be preferred.
mkdir -p "$out/static/$LIBDIR"
cp -r "$WORK/moved/include" "$out/static/"
cp -r "$WORK/moved/$LIBDIR/pkgconfig" "$WORK/moved/$LIBDIR/libaccessvdb.a" "$out/static/$LIBDIR/"
export PKG_CONFIG_PATH=$out/static/$LIBDIR/pkgconfig
# shellcheck disable=SC2046
"$CXX" "$out/main.o" -o "$out/consumer_static" $(pkg-config --static --libs accessvdb)
"$out/consumer_static" "$out/field_static"
cmp "$out/field/points.ply" "$out/field_static/points.ply"

# C, with the same file.
export PKG_CONFIG_PATH=$WORK/moved/$LIBDIR/pkgconfig
# shellcheck disable=SC2046
"$CC" -std=c99 -Wall -Werror "$SOURCE/tests/package/c_api_in_c.c" -o "$out/in_c" $(pkg-config --cflags --libs accessvdb)
LD_LIBRARY_PATH=$WORK/moved/$LIBDIR "$out/in_c" "$out/field_c"
