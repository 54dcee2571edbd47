// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What a comparison found as one HTML page without scripts, which opens in any browser and prints.
/// Made for the program `accessvdb`: unlike the headers above this folder, it may change with every version.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "accessvdb/export.h"

namespace accessvdb::io {

struct ResultPage {
  std::string kind;                    ///< what sort of page it is: "What changed"
  std::string title, client, site;     ///< what it is called, for whom it is and of which place; empty: nothing
  std::vector<std::string> sentences;  ///< at the top
  struct Table {
    std::string heading;
    std::vector<std::string> columns;
    std::vector<std::vector<std::string>> rows;  ///< [rows][columns]
  };
  std::vector<Table> tables;
  std::vector<std::string> warnings;

  /// Kinds of points in the pictures, seen from above and from the side. A cell has the kind of which it holds most.
  struct Mark {
    std::string name, colour;  ///< as CSS has it: "#1a7f37"
  };
  std::vector<Mark> marks;
  using TakeMarked = std::function<void(const Eigen::Vector3d& p_W, std::optional<std::size_t> mark)>;
  /// Hands over all points, those that nothing is said about without a mark. Called twice. Empty: no pictures.
  std::function<void(const TakeMarked&)> visit = {};
  double voxel_size_m = 0;
};

/// All texts are taken as texts: none can become part of the page's code.
[[nodiscard]] ACCESSVDB_API std::string htmlOf(const ResultPage& page);

}  // namespace accessvdb::io
