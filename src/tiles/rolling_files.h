// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The files of a tile of a rolling field: X_Y.SERIAL.state and X_Y.SERIAL.ids. None is written twice.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/accessibility_field.h"
#include "field/state/state_reader.h"
#include "tiles/ray_shard.h"

namespace accessvdb::tiles {

struct RollingFiles {
  RollingFiles(const std::filesystem::path& folder, const TileIndex& tile, std::uint64_t serial);
  /// Both, whole, or none; on the disk for good after bringToDisk(). @return a hash of both  @throws OutputError
  [[nodiscard]] std::string write(const AccessibilityField& field, const std::vector<std::uint32_t>& point_ids) const;
  /// @throws OutputError
  void bringToDisk() const;
  /// @param sha256  write()  @throws InputError "state.damaged"; another one if the file cannot be read
  [[nodiscard]] std::vector<std::uint32_t> readIds(std::size_t count, const std::string& sha256) const;
  /// That the state is the one that was written, and not one of another moment. @throws InputError "state.damaged"
  void requireWritten(const internal::StateReader& read, const std::string& sha256) const;
  void remove() const noexcept;

  std::filesystem::path state, ids;
};

/// The number of a file of ours, by its name.
[[nodiscard]] std::optional<std::uint64_t> serialOf(const std::string& file_name);
/// Whether a file is one of ours, by its name and its first bytes. @param serial  gets its number
[[nodiscard]] bool isRollingFile(const std::filesystem::path& file, std::uint64_t& serial);

}  // namespace accessvdb::tiles
