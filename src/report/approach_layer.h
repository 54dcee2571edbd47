// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// approaches.json as the page shows it.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "report/field_folder.h"

namespace accessvdb::internal {

/// Targets of a file, which must be points of the map: a machine must not be sent to a place that is not in it.
class ApproachLayer {
 public:
  /// @param path  the file or its folder
  /// @throws InputError "input.missing"; "input.approaches" for other content, numbers that are not finite,
  /// orientations that are not unit quaternions, contact beside the point
  explicit ApproachLayer(const std::filesystem::path& path);

  /// Looks whether it is a target. To be called with all points of the map.
  void see(const std::string& tile, const SurfacePoint& point);
  /// With the tile and the tool (an index in the map's tools, or null) of each target.
  /// @throws UnusableInput "approaches.other_map" for a target that is no point of the map
  [[nodiscard]] nlohmann::ordered_json shown(const FieldFolder& folder) const;
  /// Of targets that can be shown, but that the map says something else about: ids and texts.
  [[nodiscard]] std::vector<std::pair<std::string, std::string>> warnings(const FieldFolder& folder) const;
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }

 private:
  struct Target {
    std::uint32_t point = 0;
    Eigen::Vector3d position_W = {0, 0, 0};
    std::string tool;
    nlohmann::ordered_json shown;
    // What the map has there:
    std::optional<Eigen::Vector3d> last_W;  ///< of the point with its id that was seen last
    std::optional<std::string> tile;        ///< of the one that is in its place
    std::uint32_t tools = 0;                ///< SurfacePoint::tools
    bool accessible = false;
  };
  [[nodiscard]] std::optional<std::size_t> toolOf(const Target& target, const FieldFolder& folder) const;

  std::filesystem::path file_;
  nlohmann::ordered_json counts_;
  std::vector<Target> targets_;
  std::unordered_multimap<std::uint32_t, std::size_t> targets_of_;  ///< by their point
};

}  // namespace accessvdb::internal
