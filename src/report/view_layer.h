// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// views.json as the page shows it.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "accessvdb/point_label.h"

namespace accessvdb::internal {

/// Poses of the sensor from which to look next.
class ViewLayer {
 public:
  /// @param path  the file or its folder
  /// @throws InputError "input.missing"; "input.views" for other content, numbers that are not finite, orientations
  /// that are not unit quaternions
  explicit ViewLayer(const std::filesystem::path& path);

  [[nodiscard]] const nlohmann::ordered_json& shown() const { return shown_; }
  /// What is odd if the map has so many points of each reason: the views may be of another map.
  [[nodiscard]] std::optional<std::string> warning(const std::array<std::uint64_t, kNumPointReasons>& points) const;
  [[nodiscard]] const std::filesystem::path& file() const { return file_; }

 private:
  std::filesystem::path file_;
  nlohmann::ordered_json shown_;
  std::uint64_t unresolved_ = 0;
};

}  // namespace accessvdb::internal
