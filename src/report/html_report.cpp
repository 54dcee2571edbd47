// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/program/html_report.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>
#include <string_view>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tool_geometry.h"
#include "report/approach_layer.h"
#include "report/field_folder.h"
#include "report/page_text.h"
#include "report/point_packer.h"
#include "report/run_record.h"
#include "report/table_maker.h"
#include "report/text_coding.h"
#include "report/tool_drawing.h"
#include "report/view_layer.h"
#include "report/voxel_thinning.h"

namespace accessvdb::io {
namespace {

using Json = nlohmann::ordered_json;

/// Drawn positions are off by half a step at most: 1/16 of a voxel. Twice as fine would make the file 6 % larger.
constexpr double kStepsPerVoxel = 8;
/// Rows of a table that the page shows.
constexpr std::size_t kMostRows = 1000;

/// Counts of the points with one label and one reason.
struct ClassCount {
  std::uint64_t points = 0, drawn = 0;
  ExactArea area = {};
};

double numberOr(const std::string& text, double otherwise) {
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && std::isfinite(value) ? value : otherwise;
}

Json jsonVector(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

/// One page being written.
class Page {
 public:
  Page(const std::filesystem::path& path, const HtmlReportOptions& options)
      : options_(options), folder_(openChecked(path)), run_(internal::RunRecord::read(path)) {
    result_.points = folder_.points;
    if (!options.approaches.empty()) approaches_.emplace(options.approaches);
    if (!options.views.empty()) views_.emplace(options.views);
    if (run_.surface_points && *run_.surface_points != folder_.points) {
      warn("report.counts", "report.json is about " + std::to_string(*run_.surface_points) +
                                " surface points, but the folder holds " + std::to_string(folder_.points));
    }
    if (!folder_.complete) warn("field.unfinished", "not all tiles of the map are finished");
    if (folder_.points == 0) warn("field.empty", "the field holds no surface points");
    const std::size_t tools = std::max<std::size_t>(folder_.tools.size(), 1);
    if (!options.tools.empty() && options.tools.size() != tools) {
      throw InvalidArgument(
          "report.tools", "tools",
          "are " + std::to_string(options.tools.size()) + ", and those of the field are " + std::to_string(tools),
          "Give one for each tool of the field, in its order, or none");
    }
    result_.cell_m = internal::thinningCell_m(folder_, options.most_points);
  }

  void write(std::ostream& out) {
    std::string_view rest = internal::kPageHtml;
    for (std::size_t at = rest.find("{{"); at != std::string_view::npos; at = rest.find("{{")) {
      out << rest.substr(0, at);
      const std::size_t end = rest.find("}}", at);
      writePart(out, rest.substr(at + 2, end - at - 2));
      rest.remove_prefix(end + 2);
    }
    out << rest;
  }
  [[nodiscard]] HtmlReport result() const { return result_; }

 private:
  internal::FieldFolder openChecked(const std::filesystem::path& path) {
    OutputCheck check(options_.allow_changed);
    auto folder = readChecked(check, [&] { return internal::FieldFolder::open(path, check); });
    result_.warnings = check.warnings();
    result_.notices = check.notices();
    return folder;
  }
  void warn(const std::string& id, const std::string& text) { result_.warnings.emplace_back(id, text); }

  void writePart(std::ostream& out, std::string_view name) {
    if (name == "policy") {
      // Nothing but this very script and style; pictures are made by the page itself, for printing.
      out << "default-src 'none'; script-src " << internal::policyHash(internal::kPageScript) << "; style-src "
          << internal::policyHash(internal::kPageStyle) << "; img-src data:; base-uri 'none'; form-action 'none'";
    } else if (name == "style") {
      out << internal::kPageStyle;
    } else if (name == "script") {
      out << internal::kPageScript;
    } else if (name == "points") {
      writePoints(out);
    } else if (name == "facts") {
      out << internal::scriptJson(facts());
    }
  }

  void writePoints(std::ostream& out) {
    internal::VoxelThinning thinning(folder_.origin_W, result_.cell_m);
    internal::PointPacker packer(
        folder_.origin_W, step_m(), !folder_.tools.empty(), !folder_.metadataOf("access_probability").empty(),
        [&](const internal::PackedBlock& block) {
          out << "<script type=\"text/plain\" class=\"points\">" << block.base64 << "</script>\n";
          blocks_.push_back({{"tile", block.tile}, {"points", block.points}, {"base", block.base}});
        });
    internal::TableMaker table(folder_);
    folder_.visit(
        [&](const internal::PointFile& file, const SurfacePoint& point, std::span<const std::int32_t> carried) {
          ClassCount& count = classes_[static_cast<std::size_t>(point.label)][static_cast<std::size_t>(point.reason)];
          ++count.points;
          count.area.steps += table.add(point, carried);
          bounds_W_.extend(point.position_W);
          if (approaches_) approaches_->see(file.tile, point);
          if (!thinning.keep(point)) return true;
          ++count.drawn;
          packer.add(file.tile, point);
          return true;
        });
    packer.finish();
    table_ = table.finish();
    if (approaches_) {
      shown_approaches_ = approaches_->shown(folder_);
      for (const auto& [id, text] : approaches_->warnings(folder_)) warn(id, text);
    }
    if (views_) {
      std::array<std::uint64_t, kNumPointReasons> points = {};
      for (const auto& of_label : classes_) {
        for (std::size_t reason = 0; reason < points.size(); ++reason) points[reason] += of_label[reason].points;
      }
      if (const auto text = views_->warning(points)) warn("views.counts", *text);
    }
    result_.drawn = thinning.kept();
    const auto list = [](const std::vector<Eigen::Vector3f>& vectors, Json& json) {
      for (const Eigen::Vector3f& vector : vectors) {
        for (int axis = 0; axis < 3; ++axis) json.push_back(std::round(vector[axis] * 1e6) / 1e6);
      }
    };
    list(packer.directions_W(), directions_);
    // Of yaw, up is up.
    if (!folder_.metadataOf("orientations").empty()) list(packer.ups_W(), ups_);
  }

  [[nodiscard]] double step_m() const { return folder_.voxel_size_m / kStepsPerVoxel; }

  /// What each of several tools reaches of a row.
  Json reached(const PointRow& row) const {
    Json list = Json::array();
    for (const ReachedByTool& tool : row.tools) {
      list.push_back({{"points", tool.points}, {"area_m2", tool.area.m2(folder_.voxel_size_m)}});
    }
    return list;
  }

  Json classes() const {
    Json list = Json::array();
    for (int label = 0; label < kNumPointLabels; ++label) {
      for (int reason = 0; reason < kNumPointReasons; ++reason) {
        const ClassCount& count = classes_[static_cast<std::size_t>(label)][static_cast<std::size_t>(reason)];
        if (count.points == 0) continue;
        list.push_back({{"label", name(static_cast<PointLabel>(label))},
                        {"reason", name(static_cast<PointReason>(reason))},
                        {"points", count.points},
                        {"drawn", count.drawn},
                        {"area_m2", count.area.m2(folder_.voxel_size_m)}});
        // Points that a tool reaches are accessible, all of them.
        if (static_cast<PointLabel>(label) == PointLabel::Accessible && !folder_.tools.empty())
          list.back()["tools"] = reached(table_.rows.front());
      }
    }
    return list;
  }

  /// The largest rows of each attribute; table.csv has all of them.
  Json tables() const {
    Json list = Json::array();
    const double v = folder_.voxel_size_m;
    for (const std::string& attribute : folder_.attributes) {
      if (!internal::hasRows(attribute)) continue;
      std::vector<const PointRow*> rows;
      for (const PointRow& row : table_.rows) {
        if (row.attribute == attribute) rows.push_back(&row);
      }
      const std::size_t all = rows.size();
      std::stable_sort(rows.begin(), rows.end(),
                       [](const PointRow* a, const PointRow* b) { return a->allArea().steps > b->allArea().steps; });
      rows.resize(std::min(rows.size(), kMostRows));
      Json lines = Json::array();
      for (const PointRow* row : rows) {
        Json areas = Json::object();
        for (int n = 0; n < kNumPointReasons; ++n) {
          const ExactArea& area = row->area[static_cast<std::size_t>(n)];
          if (area.steps > 0) areas[name(static_cast<PointReason>(n))] = area.m2(v);
        }
        lines.push_back({{"id", row->id ? Json(*row->id) : Json(nullptr)},
                         {"points", row->allPoints()},
                         {"area_m2", row->allArea().m2(v)},
                         {"reasons_m2", areas},
                         {"low", jsonVector(row->box_W.min())},
                         {"high", jsonVector(row->box_W.max())}});
        if (!folder_.tools.empty()) lines.back()["tools"] = reached(*row);
      }
      list.push_back({{"attribute", attribute}, {"rows", lines}, {"rows_total", all}});
    }
    return list;
  }

  /// Holds a tool against the one of the run.
  std::string toolDifference(std::size_t k) {
    const DrawnTool& tool = options_.tools[k];
    const std::string wanted = folder_.metadataOf(ofTool(k) + "sha256");
    if (wanted.empty()) return "The field does not say which tool it was made for.";
    if (wanted == tool.geometry->sha256()) return {};
    const auto of_run = k < run_.tool_files.size() ? run_.sha256_of.find(run_.tool_files[k]) : run_.sha256_of.end();
    const bool same_file = !tool.file.empty() && of_run != run_.sha256_of.end() && !of_run->second.empty() &&
                           sha256OfFile(tool.file) == of_run->second;
    const std::string text =
        same_file ? "This is the file of the run's tool, but with another unit, tip, axis or up than there."
                  : "This is not the tool of the run: its SHA-256 differs.";
    warn("report.tool", (folder_.tools.empty() ? "" : "Tool " + folder_.tools[k] + ": ") + text +
                            " Labels and directions are those of the run's tool.");
    return text;
  }

  /// How keys of the metadata about a tool begin.
  [[nodiscard]] std::string ofTool(std::size_t k) const {
    return folder_.tools.empty() ? "tool_" : "tool_" + folder_.tools[k] + "_";
  }

  /// The k-th tool as it is drawn; null if it is not.
  Json drawn(std::size_t k) {
    if (k >= options_.tools.size() || options_.tools[k].geometry == nullptr) return nullptr;
    const ToolGeometry& tool = *options_.tools[k].geometry;
    const Eigen::Vector3d size_m = (tool.max_T() - tool.min_T()).cast<double>();
    Json json = {{"name", tool.name()},       {"sha256", tool.sha256()},         {"size_m", jsonVector(size_m)},
                 {"reach_m", tool.reach_m()}, {"watertight", tool.watertight()}, {"difference", toolDifference(k)}};
    json.update(
        internal::drawTool(tool, {folder_.voxel_size_m, numberOr(folder_.metadataOf("self_exclusion_voxels"), 3.0)}));
    return json;
  }

  /// Not of report.json, which has the hash of this page.
  Json hashes() const {
    Json list = Json::array();
    const auto add = [&](const std::filesystem::path& path) {
      if (isFile(path)) {
        list.push_back({{"path", path.filename().string()}, {"sha256", sha256OfFile(path)}});
      }
    };
    add(folder_.path / (folder_.files.size() == 1 && folder_.files[0].tile.empty() ? "points.ply" : "field.json"));
    if (approaches_) add(approaches_->file());
    if (views_) add(views_->file());
    return list;
  }

  Json facts() {
    Json metadata = Json::object();
    for (const auto& [key, text] : folder_.metadata) metadata[key] = text;
    Json json = {
        {"format", 1},
        {"name", std::filesystem::absolute(folder_.path).lexically_normal().filename().string()},
        {"frame",
         {{"origin_W", jsonVector(folder_.origin_W)}, {"step_m", step_m()}, {"voxel_size_m", folder_.voxel_size_m}}},
        {"points", {{"total", result_.points}, {"drawn", result_.drawn}, {"cell_m", result_.cell_m}}},
        {"classes", classes()},
        {"bounds", nullptr},
        {"tiles", folder_.files.empty() || !folder_.files[0].tile.empty() ? folder_.files.size() : 0},
        {"blocks", blocks_},
        {"directions", directions_},
        {"metadata", metadata},
        {"run", run_.shown},
        {"hashes", hashes()},
        {"tool", folder_.tools.empty() ? drawn(0) : Json(nullptr)}};
    for (std::size_t k = 0; k < folder_.tools.size(); ++k)
      json["tools"].push_back({{"name", folder_.tools[k]},
                               {"margin_m", numberOr(folder_.metadataOf(ofTool(k) + "margin_m"), 0)},
                               {"drawn", drawn(k)}});
    if (!ups_.empty()) json["ups"] = ups_;
    if (approaches_) json["approaches"] = shown_approaches_;
    if (views_) json["views"] = views_->shown();
    if (!folder_.attributes.empty()) json["tables"] = tables();
    for (const auto& [key, text] : {std::pair<const char*, const std::string&>{"title", options_.title},
                                    {"client", options_.client},
                                    {"site", options_.site}}) {
      if (!text.empty()) json["header"][key] = text;
    }
    if (!bounds_W_.isEmpty()) json["bounds"] = {jsonVector(bounds_W_.min()), jsonVector(bounds_W_.max())};
    Json problems = Json::array();
    for (const auto& [id, text] : result_.warnings) problems.push_back({{"id", id}, {"text", text}});
    json["problems"] = problems;
    return json;
  }

  const HtmlReportOptions& options_;
  HtmlReport result_;
  internal::FieldFolder folder_;
  internal::RunRecord run_;
  std::array<std::array<ClassCount, kNumPointReasons>, kNumPointLabels> classes_ = {};
  PointTable table_;
  std::optional<internal::ApproachLayer> approaches_;
  std::optional<internal::ViewLayer> views_;
  Eigen::AlignedBox3d bounds_W_;
  Json blocks_ = Json::array(), directions_ = Json::array(), ups_ = Json::array(), shown_approaches_;
};

}  // namespace

HtmlReport writeHtmlReport(const std::filesystem::path& html, const std::filesystem::path& folder,
                           const HtmlReportOptions& options) {
  if (options.most_points < HtmlReportOptions::kLeastPoints) {
    throw InvalidArgument("report.most_points", "most_points",
                          "must be at least " + std::to_string(HtmlReportOptions::kLeastPoints));
  }
  if (!isFolder(folder)) {
    throw InputError("input.no_field", folder.string(), "is not a folder", "Name the output folder of accessvdb map");
  }
  Page page(folder, options);
  writeFileDurably(html, [&](std::ostream& out) { page.write(out); });
  return page.result();
}

}  // namespace accessvdb::io
