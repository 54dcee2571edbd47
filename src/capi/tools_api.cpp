// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Several tools in C.
#include <memory>
#include <utility>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "accessvdb/c_api.h"
#include "capi/boundary.h"
#include "capi/handles.h"
#include "capi/params_from_c.h"
#include "capi/tools_from_c.h"

namespace capi = accessvdb::capi;
using accessvdb::AccessibilityField;

int accessvdb_field_create_tools(const accessvdb_tool_spec* tools, std::size_t spec_size, std::size_t tool_count,
                                 const accessvdb_params* params, accessvdb_field** field,
                                 accessvdb_error* error) noexcept {
  if (field != nullptr) *field = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("field", field);
    std::vector<accessvdb::ToolSpec> specs = capi::toolsFromC(tools, spec_size, tool_count);
    const accessvdb::FieldParams given = capi::paramsOrDefaults(params);
    *field = std::make_unique<accessvdb_field>(AccessibilityField(std::move(specs), given)).release();
  });
}

int accessvdb_field_load_state_tools(const char* file, const accessvdb_tool_spec* tools, std::size_t spec_size,
                                     std::size_t tool_count, std::int32_t backend, std::int32_t threads,
                                     accessvdb_field** field, accessvdb_error* error) noexcept {
  if (field != nullptr) *field = nullptr;
  return capi::guardedWithout(error, [&] {
    capi::requirePointer("field", field);
    capi::requireText("file", file, "Name the file of the state");
    std::vector<accessvdb::ToolSpec> specs = capi::toolsFromC(tools, spec_size, tool_count);
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
  return capi::takeSnapshot(capi::isField(field), field, point_count, [&] { return field->field.toolSnapshot(tool); });
}
