// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// A plot with labels, and the results as a reader of its own sees them.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace accessvdb::survey_test {

/// The walk of large_test as a ray cloud with an int `tree_id` (slices of 0.7 m along the walk, every seventh return
/// without one, -1), a uchar `class` (2 below, 5 above, sometimes 6), and a float `loudness` that is no whole number.
void writeLabelledWalk(const std::filesystem::path& file);

/// A binary little-endian PLY, parsed here: columns by name, rows in order.
struct Ply {
  explicit Ply(const std::string& bytes);
  std::map<std::string, std::vector<double>> column;
  std::vector<std::string> names;  ///< in their order
  std::string header;
  std::size_t rows = 0;
};

using Vector = std::array<double, 3>;
/// What the header says.
[[nodiscard]] Vector originOf(const Ply& points);
/// docs/report.md, "Area": a large square in the plane, cut to the voxel of edge v face by face.
[[nodiscard]] double sectionOf(const Vector& p, const Vector& n, const Vector& origin, double v);

/// A CSV with a line of names: rows by name of column.
[[nodiscard]] std::vector<std::map<std::string, std::string>> parsedCsv(const std::string& text);
/// A decimal number as a whole number of 1e-9 or, of more decimals, 1e-12: sums of these are exact.
using Exact = std::uint64_t;
[[nodiscard]] Exact exactly(const std::string& decimal, int decimals);

}  // namespace accessvdb::survey_test
