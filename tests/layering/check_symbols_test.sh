#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# Shows that check_symbols.sh and check_type_names.sh fire, on small objects: check_symbols_test.sh COMPILER
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
checker=$here/check_symbols.sh
compiler=${1:?usage: check_symbols_test.sh COMPILER}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

compile() { "$compiler" -x c++ -c - -o "$folder/$1.o"; }
compile clean <<<'namespace nanovdb { void f(); } void g() { nanovdb::f(); }'
compile calls <<<'namespace openvdb { void initialize(); } void g() { openvdb::initialize(); }'
compile inlined <<<'namespace openvdb { template <class T> void f(T) {} } void g() { openvdb::f(1); }'

"$checker" "$folder/clean.o" || { echo "FAILED: a clean object is reported"; exit 1; }
for object in calls inlined; do
  if "$checker" "$folder/clean.o" "$folder/$object.o" >"$folder/out"; then
    echo "FAILED: '$object' is not reported"
    exit 1
  fi
  grep -q "$object.o uses OpenVDB" "$folder/out" || { echo "FAILED: the report does not name '$object'"; exit 1; }
done

compile first <<<'namespace accessvdb::io { struct Map { void f(); }; void Map::f() {} } namespace { struct Map {}; void f(Map*) {} }'
compile other <<<'namespace accessvdb { struct Map; void f(const Map&) {} namespace io { struct Own {}; void g(Own) {} } }'
"$here/check_type_names.sh" "$folder/first.o" || { echo "FAILED: one type is reported"; exit 1; }
if "$here/check_type_names.sh" "$folder/first.o" "$folder/other.o" >"$folder/out"; then
  echo "FAILED: two types of one name are not reported"
  exit 1
fi
[[ $(<"$folder/out") == "type-name: Map is accessvdb::"* ]] || { echo "FAILED: $(<"$folder/out")"; exit 1; }
echo "every rule fires"
