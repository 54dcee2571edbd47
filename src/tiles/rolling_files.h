// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The files of a tile of a rolling field: X_Y.SERIAL.state and X_Y.SERIAL.ids. None is written twice.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "tiles/ray_shard.h"

namespace accessvdb::tiles {

struct RollingFiles {
  RollingFiles(const std::filesystem::path& folder, const TileIndex& tile, std::uint64_t serial);
  /// Both, whole, or none. @return hash of the ids  @throws OutputError
  [[nodiscard]] std::string write(const AccessibilityField& field, const std::vector<std::uint32_t>& point_ids) const;
  /// @throws InputError "state.damaged"; another one if the file cannot be read
  [[nodiscard]] std::vector<std::uint32_t> readIds(std::size_t count, const std::string& sha256) const;
  void remove() const noexcept;

  std::filesystem::path state, ids;
};

/// Whether a name is one that we give. @param serial  gets its number
[[nodiscard]] bool isRollingFile(const std::string& name, std::uint64_t& serial);

}  // namespace accessvdb::tiles
