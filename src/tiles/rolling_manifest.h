// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// rolling.json: what a rolling field knows besides its tiles, and which files those are in.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/params.h"
#include "accessvdb/tool_spec.h"
#include "accessvdb/types.h"
#include "tiles/json_file.h"

namespace accessvdb::tiles {

inline constexpr const char* kRollingManifest = "rolling.json";

/// What a field must have been made with to go on.
struct MadeWith {
  const std::vector<ToolSpec>& tools;
  const FieldParams& params;  ///< resolved, for the first tool
  std::int32_t tile_voxels;
};

/// Returns of all steps.
struct TakenReturns {
  std::uint64_t points_in = 0, points_used = 0;
  std::array<std::uint64_t, kNumDropReasons> dropped = {};
};

struct RollingManifest {
  std::uint32_t points = 0;
  std::uint64_t scans = 0;  ///< with a return; counted for ChangeMode::Full
  double age_s = 0;
  std::uint64_t left_out_returns = 0;
  std::vector<std::uint32_t> first_ids;  ///< of each step: the first point that it brought has this id
  std::vector<double> stamps_s;          ///< of each step; NaN: none
  std::vector<double> farthest_m;        ///< of each step, as in Binned
  std::vector<std::string> lost_tiles;
  std::vector<std::array<double, 4>> closed;  ///< RollingTiles::closed(): centre and radius
  std::string note;                           ///< of the caller
  TakenReturns taken;
  Json tiles;  ///< RollingTiles::saveAll()
  std::optional<std::array<double, 3>> origin_W;
  std::optional<double> latest_s;
  std::optional<std::array<double, 9>> levelling;  ///< RollingField::levelling(), column by column
};

/// @throws OutputError where that cannot be seen
[[nodiscard]] bool hasManifest(const std::filesystem::path& folder);
/// @throws InputError "rolling.missing"
void requireManifest(const std::filesystem::path& folder);
/// Whole or not at all. @throws OutputError
void writeManifest(const std::filesystem::path& folder, const RollingManifest& manifest, const MadeWith& made_with);
/// @param take  what it throws of nlohmann::json makes the manifest a damaged one
/// @throws InputError "rolling.missing", "rolling.damaged"
void readManifest(const std::filesystem::path& folder, const std::function<void(const Json& json)>& take);
[[nodiscard]] std::int32_t tileVoxelsOf(const Json& json);
/// @throws UnusableInput "rolling.changed"; InputError "rolling.damaged"; nlohmann::json::exception
[[nodiscard]] RollingManifest manifestFrom(const Json& json, const std::filesystem::path& folder,
                                           const MadeWith& made_with);
/// @throws InputError "rolling.damaged"
[[noreturn]] void refuseManifest(const std::filesystem::path& folder);

}  // namespace accessvdb::tiles
