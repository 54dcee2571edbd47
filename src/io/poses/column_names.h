// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a line of column names says, as pose files, trajectories and lists of stations begin with.
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace accessvdb::io {

struct NamedColumns {
  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  std::size_t count = 0;        ///< columns that the line names
  std::size_t known = 0;        ///< of them, those whose meaning is known
  std::size_t first_known = 0;  ///< words before it may be text
  std::size_t file = kNone;     ///< the name of a scan's file
  std::size_t index = kNone;    ///< the number of a scan
  std::size_t time = kNone;
  std::size_t nanoseconds = kNone;                     ///< to be added to `time`, which is in whole seconds
  std::optional<double> time_unit_s = {};              ///< nothing: not said
  std::array<std::size_t, 3> position = unknown<3>();  ///< x y z
  double position_unit_m = 1;
  std::array<std::size_t, 4> quaternion = unknown<4>();  ///< w x y z
  std::array<std::size_t, 12> matrix = unknown<12>();    ///< 3 x 4, row by row
  bool geographic = false;                               ///< latitude and longitude instead of x and y
  std::string conflict = {};                             ///< what two columns claim to be; or a unit that is not read

  template <std::size_t kSize>
  [[nodiscard]] static constexpr std::array<std::size_t, kSize> unknown() {
    std::array<std::size_t, kSize> columns = {};
    columns.fill(kNone);
    return columns;
  }
  [[nodiscard]] bool hasTime() const { return time != kNone; }
  [[nodiscard]] bool hasPosition() const { return allKnown(position); }
  [[nodiscard]] bool hasQuaternion() const { return allKnown(quaternion); }
  [[nodiscard]] bool hasMatrix() const { return allKnown(matrix); }
  [[nodiscard]] bool hasPose() const { return hasMatrix() || (hasPosition() && hasQuaternion()); }
  /// The largest of the columns that are read. @param pose  else only time and position are
  [[nodiscard]] std::size_t last(bool pose) const;
  /// All columns that many places further left, for text before the names.
  void moveLeft(std::size_t places);

 private:
  template <std::size_t kSize>
  [[nodiscard]] static bool allKnown(const std::array<std::size_t, kSize>& columns) {
    for (const std::size_t column : columns)
      if (column == kNone) return false;
    return true;
  }
};

/// @param line  without the sign of a comment @return nothing for a line that names neither positions nor matrices
[[nodiscard]] std::optional<NamedColumns> parseColumnNames(std::string_view line);

/// Cells between semicolons, commas or tabs, whichever comes first in this list and occurs; blanks and quotes around
/// them removed, empty ones kept. Nothing if there is no such separator.
[[nodiscard]] std::vector<std::string_view> strictCells(std::string_view line);

}  // namespace accessvdb::io
