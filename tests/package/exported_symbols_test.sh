#!/usr/bin/env bash
# Copyright Contributors to the AccessVDB project
# SPDX-License-Identifier: Apache-2.0
# The checker of exported symbols works: it refuses each bad library below and accepts a good one.
set -euo pipefail
here=$(dirname "${BASH_SOURCE[0]}")
command -v nm >/dev/null || { echo "skipped: nm (binutils) is missing"; exit 77; }
folder=$WORK/exported_symbols
rm -rf "$folder"
mkdir -p "$folder/include"
cat >"$folder/include/c_api.h" <<'END'
ACCESSVDB_API int accessvdb_one(void);
END
cat >"$folder/include/field.h" <<'END'
class ACCESSVDB_API Field {};
namespace io { ACCESSVDB_API void write(); }
END
good='extern "C" int accessvdb_one() { return 1; }
namespace accessvdb { struct Field { Field(); }; Field::Field() {} namespace io { void write() {} } }'

bad=0
# judge NAME accepted|refused CODE
judge() {
  echo "$3" >"$folder/$1.cpp"
  "$CXX" -shared -fPIC "$folder/$1.cpp" -o "$folder/$1.so"
  local verdict=accepted
  "$here/exported_symbols.sh" "$folder/$1.so" "$folder/include" >"$folder/$1.log" || verdict=refused
  [[ $verdict == "$2" ]] || { echo "$1: $verdict"; cat "$folder/$1.log"; bad=1; }
}
judge good accepted "$good"
judge missing_c refused 'namespace accessvdb { void write() {} }'
judge missing_cpp refused 'extern "C" int accessvdb_one() { return 1; } namespace accessvdb { struct Field { Field(); }; Field::Field() {} }'
judge named_in_another refused 'extern "C" int accessvdb_one() { return 1; } namespace accessvdb { namespace io { void write(int) {} struct Field { Field(); }; } }
namespace accessvdb { struct Field; namespace io { void write(accessvdb::Field*) {} } }'
judge extra_c refused "$good extern \"C\" int accessvdb_two() { return 2; }"
judge internal refused "$good namespace accessvdb { namespace internal { void f() {} } }"
judge unmarked_class refused "$good namespace accessvdb { struct Fielder { Fielder(); }; Fielder::Fielder() {} }"
judge foreign refused "$good namespace openvdb { void f() {} }"
judge implementation refused "$good namespace accessvdb { struct Store { struct Impl { void f(); }; }; void Store::Impl::f() {} }"
exit $bad
