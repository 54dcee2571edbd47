// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/saved_state.h"

#include "field/state/state_reader.h"

namespace accessvdb {

SavedState inspectState(const std::filesystem::path& file) {
  const internal::StateReader reader(file);
  const internal::StateHead& head = reader.head();
  SavedState state;
  state.version = head.version;
  state.tool_sha256 = head.tool_sha256;
  for (const internal::SavedTool& tool : head.tools) {
    state.tools.push_back({tool.name, tool.sha256, tool.orientations, tool.rolls, tool.max_collisions});
  }
  constexpr const char* kHex = "0123456789abcdef";
  for (const unsigned char byte : reader.headDigest()) {
    state.sha256 += kHex[byte >> 4];
    state.sha256 += kHex[byte & 15];
  }
  state.params = head.params;
  state.updated = head.updated;
  state.scans = head.scans;
  state.latest_stamp_s = head.latest_stamp_s;
  state.leaves = head.leaves;
  state.points = head.points;
  return state;
}

}  // namespace accessvdb
