// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Points as lines of text, as exporters write them: x y z and more, in the columns that a line of names says if there
/// is one, with the number of points before them if there is one.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/streams/text_lines.h"

namespace accessvdb::io {

class PointLines {
 public:
  /// Where it stands; only a place that was reached before may be returned to.
  struct Place {
    std::uint64_t byte = 0, line = 0, points = 0, announced = 0;
  };

  /// @param lines  must outlive this
  explicit PointLines(LineReader& lines) : lines_(lines) {}

  /// The next point, not checked to be finite: values that are missing ("null", "n/a", nothing) are NaN.
  /// @return false at the end, or before a last line that was cut off
  /// @throws InputError naming the line (no numbers, decimal commas, columns without x y z or in another unit)
  bool next(Eigen::Vector3d& p);
  [[nodiscard]] Place place() const { return {lines_.offset(), lines_.number(), points_, announced_}; }
  void seek(const Place& place);

  [[nodiscard]] std::uint64_t points() const { return points_; }  ///< so far
  /// By the lines with a count so far; nothing without such a line.
  [[nodiscard]] std::optional<std::uint64_t> announced() const;
  [[nodiscard]] bool cutOff() const { return cut_off_; }                   ///< the last line is incomplete
  [[nodiscard]] std::size_t columns() const { return values_.size(); }     ///< of the last point
  [[nodiscard]] bool named() const { return names_ && !names_->comment; }  ///< a line says which column is what
  /// At the end. @throws InputError "input.geographic" if the points can only be latitude and longitude in degrees
  void refuseDegrees() const;
  [[nodiscard]] std::string heading() const;  ///< what was skipped before the points, in words; empty if nothing was

 private:
  using Columns = std::array<std::size_t, 3>;
  struct Names {
    Columns xyz = {};
    std::string text = {};
    std::size_t columns = 0;
    std::size_t line = 0;
    bool comment = false;
  };

  /// What the points cover, and with how many decimals the first of them are written.
  struct Extent {
    Eigen::Vector3d low = Eigen::Vector3d::Constant(1e300), high = -low;
    std::array<std::size_t, 3> decimals = {};
    int looked = 0;
    bool whole = true;  ///< from the first point on
    void add(const Eigen::Vector3d& p, const std::vector<std::string_view>& cells, const Columns& xyz);
  };

  [[nodiscard]] std::optional<Names> namesIn(std::string_view line, bool comment) const;
  /// @param separator  0: blanks, tabs, commas and semicolons
  [[nodiscard]] std::optional<Names> namesIn(std::string_view line, char separator, bool comment) const;
  void readHeading(std::string_view line);
  void checkNames();
  [[nodiscard]] bool readValues(Eigen::Vector3d& p) const;

  LineReader& lines_;
  std::vector<std::string_view> values_;
  std::optional<Names> names_;
  std::uint64_t points_ = 0, announced_ = 0;
  std::optional<std::size_t> count_line_;
  bool cut_off_ = false;
  Extent extent_;
};

}  // namespace accessvdb::io
