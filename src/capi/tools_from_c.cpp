// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "capi/tools_from_c.h"

#include <algorithm>
#include <cstring>
#include <string>

#include "capi/boundary.h"
#include "capi/handles.h"

namespace accessvdb::capi {
namespace {

constexpr std::size_t kSpecBytes1 = 32;  ///< size of the first version
static_assert(sizeof(accessvdb_tool_spec) >= kSpecBytes1);

}  // namespace

std::vector<ToolSpec> toolsFromC(const accessvdb_tool_spec* tools, std::size_t size, std::size_t count) {
  requireSize("spec_size", size, kSpecBytes1);
  requireArray("tools", tools, count, size, alignof(accessvdb_tool_spec));
  std::vector<ToolSpec> specs;
  const auto* bytes = reinterpret_cast<const unsigned char*>(tools);
  for (std::size_t k = 0; k < count; ++k) {
    accessvdb_tool_spec c = {};
    std::memcpy(&c, bytes + k * size, std::min(size, sizeof c));
    if (size > sizeof c) requireZero("tools", bytes + k * size + sizeof c, bytes + (k + 1) * size);
    if (!isTool(c.tool)) {
      throw InvalidArgument("c_api.handle", "tools[" + std::to_string(k) + "].tool", "is not a tool", "Make one first");
    }
    specs.push_back({c.margin_m == 0 ? c.tool->tool : c.tool->tool.grownBy(c.margin_m),
                     c.orientations != nullptr ? OrientationSet::parse(c.orientations) : OrientationSet::yaw(), c.rolls,
                     c.name != nullptr ? c.name : "", c.max_collisions});
  }
  return specs;
}

}  // namespace accessvdb::capi
