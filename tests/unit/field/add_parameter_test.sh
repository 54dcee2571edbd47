#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# A new parameter takes three edits, of which the compiler asks for the row: on a copy of the sources, with the tests of
# params_rows_test.cpp. Only the number of the files' layout has to be raised besides.
set -euo pipefail
copy=$WORK/add_parameter
rm -rf "$copy"
mkdir -p "$copy/objects"
cp -r "$SOURCE/include" "$copy"

# edit FILE OLD NEW: replaces one line's text, which must be there.
edit() {
  grep -qF "$2" "$copy/include/accessvdb/$1" || { echo "add_parameter_test.sh has to be adapted: $1 has no \"$2\""; exit 1; }
  OLD=$2 NEW=$3 awk 'BEGIN { old = ENVIRON["OLD"] } !done && (at = index($0, old)) {
    $0 = substr($0, 1, at - 1) ENVIRON["NEW"] substr($0, at + length(old)); done = 1 } { print }' \
    "$copy/include/accessvdb/$1" >"$copy/edited"
  mv "$copy/edited" "$copy/include/accessvdb/$1"
}
compile() {
  "$CXX" -std=c++20 -O0 -Wall -Wextra -Werror "-I$copy/include" "-I$SOURCE/src" "-I$SOURCE/nanovdb_kernels" \
    "-I$SOURCE/nanovdb_kernels/hostdev" -isystem "$EIGEN" -c "$SOURCE/$1" -o "$copy/objects/$(basename "$1").o"
}

edit params.h 'double stability_min = 0.7;' 'double stability_min = 0.7, added_rad = 0.25;'
if compile src/field/params.cpp 2>"$copy/without_row.log"; then
  echo "a field without a row compiles"
  exit 1
fi
grep -q 'static assertion failed' "$copy/without_row.log" || { cat "$copy/without_row.log"; exit 1; }
edit params_rows.h 'paramRow<&UpdateParams::seed,' 'paramRow<&UpdateParams::added_rad, &accessvdb_params::added_rad>(
        "added_rad", ParamRange{0, 3}, "Added by a test."), paramRow<&UpdateParams::seed,'
edit c_api.h '} accessvdb_params;' 'double added_rad; } accessvdb_params;'

for file in src/field/params.cpp src/field/carry.cpp src/field/state/state_head.cpp src/capi/params_from_c.cpp src/capi/boundary.cpp \
  src/tool/orientation_set.cpp src/tool/orientation_text.cpp tests/unit/field/params_rows_test.cpp; do
  compile "$file"
done
# shellcheck disable=SC2086  # the libraries are several words
"$CXX" "$copy"/objects/*.o $GTEST -pthread -o "$copy/test"
"$copy/test" --gtest_filter='-*.MakeStatesOfThisSchema' --gtest_brief=1
if "$copy/test" --gtest_filter='*.MakeStatesOfThisSchema' --gtest_brief=1 >"$copy/schema.log"; then
  echo "the layout of saved states has changed unnoticed"
  exit 1
fi
