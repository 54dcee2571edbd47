// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "report/table_maker.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <utility>

#include "accessvdb/output_check.h"
#include "io/streams/exact_text.h"
#include "report/field_folder.h"
#include "report/surface_area.h"

namespace accessvdb::internal {
namespace {

constexpr double kFine_m = 0.01;
/// Points beside the surface stand for none of it.
constexpr int kReasonsWithArea = static_cast<int>(PointReason::BesideSurface);
static_assert(kReasonsWithArea + 1 == kNumPointReasons);

int decimalsOf(double voxel_size_m) { return voxel_size_m < kFine_m ? 12 : 9; }
double stepsPer_m2(double voxel_size_m) { return voxel_size_m < kFine_m ? 1e12 : 1e9; }

/// @param tools  number of several; 0 with one tool
void addPoint(const SurfacePoint& point, std::uint64_t steps, std::size_t tools, io::PointRow& row) {
  ++row.points[static_cast<std::size_t>(point.label)];
  row.area[static_cast<std::size_t>(point.reason)].steps += steps;
  if (point.label == PointLabel::Unscored) row.unscored.steps += steps;
  if (point.score != kNoScore) {
    row.score_sum += point.score;
    ++row.scored;
  }
  row.box_W.extend(point.position_W);
  row.tools.resize(tools);
  for (std::size_t k = 0; k < tools; ++k) {
    if ((point.tools >> k & 1) == 0) continue;
    ++row.tools[k].points;
    row.tools[k].area.steps += steps;
  }
}

std::string fixedText(double value, int decimals) {
  std::array<char, 64> text;
  return {text.data(),
          std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::fixed, decimals).ptr};
}

}  // namespace

bool hasRows(const std::string& attribute) { return attribute != "scan" && attribute != "index"; }

TableMaker::TableMaker(const FieldFolder& folder)
    : origin_W_(folder.origin_W),
      voxel_size_m_(folder.voxel_size_m),
      cell_m_(io::pointCell_m(folder.metadata, folder.voxel_size_m)),
      tools_(folder.tools) {
  for (std::size_t column = 0; column < folder.attributes.size(); ++column) {
    if (!hasRows(folder.attributes[column])) continue;
    names_.push_back(folder.attributes[column]);
    columns_.push_back(column);
  }
  rows_.resize(names_.size());
  whole_.tools.resize(tools_.size());
}

std::uint64_t TableMaker::add(const SurfacePoint& point, std::span<const std::int32_t> carried) {
  const std::uint64_t steps = io::areaOf(point, origin_W_, voxel_size_m_, cell_m_).steps;
  addPoint(point, steps, tools_.size(), whole_);
  for (std::size_t c = 0; c < rows_.size(); ++c) addPoint(point, steps, tools_.size(), rows_[c][carried[columns_[c]]]);
  return steps;
}

io::PointTable TableMaker::finish() const {
  io::PointTable table = {voxel_size_m_, tools_, {whole_}};
  for (std::size_t c = 0; c < rows_.size(); ++c) {
    std::vector<std::int32_t> ids;
    for (const auto& [id, row] : rows_[c]) ids.push_back(id);
    // Points without one come last.
    std::sort(ids.begin(), ids.end(), [](std::int32_t a, std::int32_t b) {
      return a == kNoAttribute || b == kNoAttribute ? a != kNoAttribute && b == kNoAttribute : a < b;
    });
    for (const std::int32_t id : ids) {
      io::PointRow& row = table.rows.emplace_back(rows_[c].at(id));
      row.attribute = names_[c];
      if (id != kNoAttribute) row.id = id;
    }
  }
  return table;
}

}  // namespace accessvdb::internal

namespace accessvdb::io {

ExactArea areaOf(const SurfacePoint& point, const Eigen::Vector3d& origin_W, double voxel_size_m, double cell_m) {
  // Voxels lie around whole numbers.
  const Eigen::Vector3d voxels = (point.position_W - origin_W) / voxel_size_m + Eigen::Vector3d::Constant(0.5);
  const Eigen::Vector3d place = voxels - voxels.array().floor().matrix();
  if (point.reason == PointReason::BesideSurface) return {};
  const bool by_cell = cell_m > 0 && point.normal_W.squaredNorm() > 0;
  const double area_m2 = by_cell ? internal::areaOfCell_m2(point.normal_W, cell_m)
                                 : internal::areaOfPoint_m2(place, point.normal_W, voxel_size_m);
  return {static_cast<std::uint64_t>(std::llround(area_m2 * internal::stepsPer_m2(voxel_size_m)))};
}

double pointCell_m(const FieldMetadata& metadata, double voxel_size_m) {
  constexpr double kMostVoxels = 100;  // as of the truncation distance, which bounds it
  for (const auto& [name, text] : metadata) {
    double spacing_m = 0;
    const char* const end = text.data() + text.size();
    if (name != "point_spacing_m" || std::from_chars(text.data(), end, spacing_m).ptr != end) continue;
    if (!(spacing_m > 0 && spacing_m <= kMostVoxels * voxel_size_m)) return 0;
    return std::max(1.0, std::round(spacing_m / voxel_size_m)) * voxel_size_m;
  }
  return 0;
}

double ExactArea::m2(double voxel_size_m) const {
  return static_cast<double>(steps) / internal::stepsPer_m2(voxel_size_m);
}

std::string ExactArea::text(double voxel_size_m) const {
  const auto decimals = static_cast<std::size_t>(internal::decimalsOf(voxel_size_m));
  std::string digits = std::to_string(steps);
  if (digits.size() <= decimals) digits.insert(0, decimals + 1 - digits.size(), '0');
  digits.insert(digits.size() - decimals, 1, '.');
  digits.erase(digits.find_last_not_of('0') + 1);
  if (digits.back() == '.') digits.pop_back();
  return digits;
}

std::uint64_t PointRow::allPoints() const { return points[0] + points[1] + points[2]; }

ExactArea PointRow::allArea() const {
  ExactArea all;
  for (const ExactArea& part : area) all.steps += part.steps;
  return all;
}

PointTable pointTable(const std::filesystem::path& path, OutputCheck& check) {
  return readChecked(check, [&] {
    const internal::FieldFolder folder = internal::FieldFolder::open(path, check);
    internal::TableMaker maker(folder);
    folder.visit([&](const internal::PointFile&, const SurfacePoint& point, std::span<const std::int32_t> carried) {
      maker.add(point, carried);
      return true;
    });
    return maker.finish();
  });
}

std::string csvOf(const PointTable& table) {
  const double v = table.voxel_size_m;
  std::string text = kTableBegin;
  text += "blocked_m2,unscored_m2";
  for (int n = 1; n < internal::kReasonsWithArea; ++n)
    text.append(",").append(name(static_cast<PointReason>(n))).append("_m2");
  text += ",mean_score,min_x,min_y,min_z,max_x,max_y,max_z,height_m,extent_m";
  for (const std::string& tool : table.tools) text.append(",accessible_").append(tool).append("_m2");
  text += "\n";
  const auto put = [&text](const std::string& cell) { text.append(",").append(cell); };
  for (const PointRow& row : table.rows) {
    const ExactArea all = row.allArea(), accessible = row.area[static_cast<std::size_t>(PointReason::None)];
    const ExactArea blocked = {all.steps - accessible.steps - row.unscored.steps};
    const double share = all.steps == 0 ? 0 : static_cast<double>(accessible.steps) / static_cast<double>(all.steps);
    text += row.attribute.empty() ? "all" : row.attribute;
    put(row.id ? std::to_string(*row.id) : "");
    put(std::to_string(row.allPoints()));
    put(all.text(v));
    put(accessible.text(v));
    put(internal::fixedText(share, 6));
    put(blocked.text(v));
    put(row.unscored.text(v));
    for (int n = 1; n < internal::kReasonsWithArea; ++n) put(row.area[static_cast<std::size_t>(n)].text(v));
    const auto scored = static_cast<double>(row.scored);
    put(row.scored > 0 ? internal::fixedText(static_cast<double>(row.score_sum) / scored, 3) : "");
    const bool empty = row.box_W.isEmpty();
    for (int n = 0; n < 3; ++n) put(empty ? "" : internal::exactText(row.box_W.min()[n]));
    for (int n = 0; n < 3; ++n) put(empty ? "" : internal::exactText(row.box_W.max()[n]));
    const Eigen::Vector3d size_m = empty ? Eigen::Vector3d(0, 0, 0) : Eigen::Vector3d(row.box_W.sizes());
    put(internal::fixedText(size_m.z(), 3));
    put(internal::fixedText(size_m.head<2>().maxCoeff(), 3));
    for (const ReachedByTool& tool : row.tools) put(tool.area.text(v));
    text += "\n";
  }
  return text;
}

}  // namespace accessvdb::io
