// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Converts parameters from C and back.
#pragma once

#include <cstdint>

#include "accessvdb/c_api.h"
#include "accessvdb/params.h"

namespace accessvdb::capi {

/// Size of the first version of accessvdb_params.
inline constexpr std::size_t kParamsBytes1 = 264;
static_assert(sizeof(accessvdb_params) >= kParamsBytes1, "fields are only ever added");

/// @throws InvalidArgument for a choice or a flag that does not exist; ranges are checked by FieldParams::resolved()
[[nodiscard]] FieldParams paramsFromC(const accessvdb_params& params);
/// Those of the caller's version. @param params  null: the defaults
/// @throws as paramsFromC(); InvalidArgument "c_api.struct_size", "c_api.unknown_fields"
[[nodiscard]] FieldParams paramsOrDefaults(const accessvdb_params* params);
/// @throws InvalidArgument
[[nodiscard]] BackendKind backendFromC(std::int32_t backend);
[[nodiscard]] accessvdb_params paramsToC(const FieldParams& params);

}  // namespace accessvdb::capi
