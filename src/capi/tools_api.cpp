// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Several tools in C.
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "capi/boundary.h"
#include "capi/handles.h"
#include "capi/params_from_c.h"

namespace capi = accessvdb::capi;
using accessvdb::AccessibilityField;
using accessvdb::InvalidArgument;

namespace {

// Size of the first version.
constexpr std::size_t kSpecBytes1 = 32;
static_assert(sizeof(accessvdb_tool_spec) >= kSpecBytes1);

std::vector<accessvdb::ToolSpec> toolsFromC(const accessvdb_tool_spec* tools, std::size_t size, std::size_t count) {
  capi::requireSize("spec_size", size, kSpecBytes1);
  capi::requireArray("tools", tools, count, size, alignof(accessvdb_tool_spec));
  std::vector<accessvdb::ToolSpec> specs;
  const auto* bytes = reinterpret_cast<const unsigned char*>(tools);
  for (std::size_t k = 0; k < count; ++k) {
    const auto& c = *reinterpret_cast<const accessvdb_tool_spec*>(bytes + k * size);
    if (size > sizeof c) capi::requireZero("tools", bytes + k * size + sizeof c, bytes + (k + 1) * size);
    if (!capi::isTool(c.tool)) {
      throw InvalidArgument("c_api.handle", "tools[" + std::to_string(k) + "].tool", "is not a tool", "Make one first");
    }
    specs.push_back({c.tool->tool,
                     c.orientations != nullptr ? accessvdb::OrientationSet::parse(c.orientations)
                                               : accessvdb::OrientationSet::yaw(),
                     c.rolls, c.name != nullptr ? c.name : "", c.max_collisions});
  }
  return specs;
}

}  // namespace

int accessvdb_field_create_tools(const accessvdb_tool_spec* tools, std::size_t spec_size, std::size_t tool_count,
                                 const accessvdb_params* params, accessvdb_field** field,
                                 accessvdb_error* error) noexcept {
  if (field != nullptr) *field = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("field", field);
    std::vector<accessvdb::ToolSpec> specs = toolsFromC(tools, spec_size, tool_count);
    accessvdb::FieldParams given;
    if (params != nullptr) {
      given = capi::paramsFromC(capi::readSized("params", params, capi::kParamsBytes1, capi::paramsToC({})));
    }
    *field = std::make_unique<accessvdb_field>(AccessibilityField(std::move(specs), given)).release();
  });
}

int accessvdb_field_load_state_tools(const char* file, const accessvdb_tool_spec* tools, std::size_t spec_size,
                                     std::size_t tool_count, std::int32_t backend, std::int32_t threads,
                                     accessvdb_field** field, accessvdb_error* error) noexcept {
  if (field != nullptr) *field = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("field", field);
    capi::requirePointer("file", file);
    if (*file == '\0') throw InvalidArgument("c_api.value", "file", "is empty", "Name the file of the state");
    std::vector<accessvdb::ToolSpec> specs = toolsFromC(tools, spec_size, tool_count);
    const accessvdb::BackendKind kind = capi::backendFromC(backend);
    *field = std::make_unique<accessvdb_field>(AccessibilityField::loadState(file, std::move(specs), kind, threads))
                 .release();
  });
}

std::size_t accessvdb_field_tool_count(const accessvdb_field* field) noexcept {
  return capi::isField(field) ? field->field.tools().size() : 0;
}

const char* accessvdb_field_tool_name(const accessvdb_field* field, std::size_t tool) noexcept {
  if (!capi::isField(field) || tool >= field->field.tools().size()) return "";
  return field->field.tools()[tool].name.c_str();
}

int accessvdb_field_take_tool_snapshot(accessvdb_field* field, std::size_t tool, std::size_t* point_count) noexcept {
  if (point_count != nullptr) *point_count = 0;
  return capi::onField(field, [&] {
    field->snapshot.reset();  // avoids two at once
    field->snapshot = field->field.toolSnapshot(tool);
    if (point_count != nullptr) *point_count = field->snapshot->points.size();
  });
}
