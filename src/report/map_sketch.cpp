// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/map_sketch.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <vector>

namespace accessvdb::internal {
namespace {

constexpr int kMostAlong = 140;  // along the longer side
constexpr const char* kPlain = "#d0d4d9";

/// Counts of each kind, by cell.
class Sketch {
 public:
  /// @param right, up  axes of the world
  Sketch(const Eigen::AlignedBox3d& box_W, int right, int up, double voxel_size_m, std::size_t marks)
      : box_W_(box_W), right_(right), up_(up), marks_(marks) {
    const double longer = std::max(box_W.sizes()[right], box_W.sizes()[up]);
    cell_m_ = std::max({longer / kMostAlong, voxel_size_m, 1e-6});
    columns_ = 1 + static_cast<std::size_t>(box_W.sizes()[right] / cell_m_);
    rows_ = 1 + static_cast<std::size_t>(box_W.sizes()[up] / cell_m_);
    counts_.resize(columns_ * rows_ * (marks + 1));
  }
  void add(const Eigen::Vector3d& p_W, std::optional<std::size_t> mark) {
    const auto x = static_cast<std::size_t>((p_W[right_] - box_W_.min()[right_]) / cell_m_);
    const auto y = static_cast<std::size_t>((box_W_.max()[up_] - p_W[up_]) / cell_m_);
    const std::size_t cell = std::min(y, rows_ - 1) * columns_ + std::min(x, columns_ - 1);
    ++counts_[cell * (marks_ + 1) + (mark ? *mark + 1 : 0)];
  }

  [[nodiscard]] std::string figure(const std::string& caption, const std::vector<io::ResultPage::Mark>& marks) const {
    std::vector<std::string> paths(marks_ + 1);
    for (std::size_t cell = 0; cell < columns_ * rows_; ++cell) {
      const auto begin = counts_.begin() + static_cast<std::ptrdiff_t>(cell * (marks_ + 1));
      // What is marked is shown, however little it is.
      const auto most = std::max_element(begin + 1, begin + 1 + static_cast<std::ptrdiff_t>(marks_));
      const bool marked = marks_ > 0 && *most > 0;
      if (!marked && *begin == 0) continue;
      std::string& path = paths[marked ? static_cast<std::size_t>(most - begin) : 0];
      path.append("M").append(std::to_string(cell % columns_)).append(" ");
      path.append(std::to_string(cell / columns_)).append("h1v1h-1z");
    }
    const double width_m = cell_m_ * static_cast<double>(columns_);
    const double bar_m = std::pow(10, std::floor(std::log10(width_m / 2)));
    std::string svg = "<figure><svg viewBox=\"0 0 " + std::to_string(columns_) + " " + std::to_string(rows_ + 3) +
                      "\" role=\"img\" shape-rendering=\"crispEdges\" aria-label=\"" + caption + "\">";
    for (std::size_t n = 0; n < paths.size(); ++n) {
      if (paths[n].empty()) continue;
      svg += "<path fill=\"" + (n == 0 ? std::string(kPlain) : marks[n - 1].colour) + "\" d=\"" + paths[n] + "\"/>";
    }
    char bar[160];
    std::snprintf(bar, sizeof bar, "<path class=\"bar\" d=\"M0 %zuh%.6gv1H0z\"/></svg><figcaption>", rows_ + 1,
                  bar_m / cell_m_);
    char length[64];
    std::snprintf(length, sizeof length, "; the bar is %.6g m</figcaption></figure>\n", bar_m);
    return svg + bar + caption + length;
  }

 private:
  Eigen::AlignedBox3d box_W_;
  int right_, up_;
  std::size_t marks_, columns_ = 1, rows_ = 1;
  double cell_m_ = 1;
  std::vector<std::uint32_t> counts_;  ///< [rows x columns x (plain, marks)]
};

}  // namespace

std::string sketchesOf(const io::ResultPage& page) {
  if (!page.visit) return {};
  Eigen::AlignedBox3d box_W;
  page.visit([&](const Eigen::Vector3d& p_W, std::optional<std::size_t>) { box_W.extend(p_W); });
  if (box_W.isEmpty()) return {};
  const int across = box_W.sizes().x() >= box_W.sizes().y() ? 0 : 1;
  std::array<Sketch, 2> sketches = {Sketch(box_W, 0, 1, page.voxel_size_m, page.marks.size()),
                                    Sketch(box_W, across, 2, page.voxel_size_m, page.marks.size())};
  page.visit([&](const Eigen::Vector3d& p_W, std::optional<std::size_t> mark) {
    for (Sketch& sketch : sketches) sketch.add(p_W, mark);
  });
  return sketches[0].figure("Seen from above, y is up", page.marks) +
         sketches[1].figure(across == 0 ? "Seen along y" : "Seen along x", page.marks);
}

}  // namespace accessvdb::internal
