// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "options/region_options.h"

#include <charconv>
#include <filesystem>
#include <limits>
#include <map>
#include <sstream>
#include <string_view>
#include <utility>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/program/segment_file.h"
#include "options/options.h"

namespace accessvdb::tools {
namespace {

namespace fs = std::filesystem;

std::vector<std::uint32_t> idsIn(const std::string& text, const std::string& subject, bool from_file) {
  std::vector<std::uint32_t> ids;
  std::string words = text;
  for (char& c : words) {
    if (c == ',') c = ' ';
  }
  std::istringstream stream(words);
  for (std::string word; stream >> word;) {
    std::uint32_t id = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), id);
    if (error == std::errc() && end == word.data() + word.size()) {
      ids.push_back(id);
      continue;
    }
    if (from_file)
      throw InputError("input.malformed", subject, "\"" + word + "\" is not an id", "Write one id per line");
    throw InvalidArgument("usage.remove", "--remove", "\"" + word + "\" is not an id",
                          "Write ids:1,2,3, or ids:FILE with one id per line");
  }
  return ids;
}

Region pointsRegion(const std::string& text) {
  if (!io::isFile(text)) return Region::points(idsIn(text, "", false));
  return Region::points(idsIn(io::contentAt(text, UINT64_MAX), text, true));
}

Region meshRegion(const std::string& file) {
  const auto read = [&] {
    try {
      return ToolGeometry::fromMesh(file, LengthUnit::Metre);
    } catch (const UnusableInput& error) {
      throw UnusableInput("region.mesh", file, error.problem(), "Give a closed triangle mesh of 1 mm to 20 m");
    }
  };
  const ToolGeometry mesh = read();
  std::vector<Eigen::Vector3d> vertices_W;
  for (const Eigen::Vector3f& p : mesh.vertices_T()) vertices_W.emplace_back(p.cast<double>());
  try {
    return Region::mesh(std::move(vertices_W), mesh.triangles());
  } catch (const UnusableInput& error) {
    throw UnusableInput(error.id(), file, error.problem(), error.advice());
  }
}

}  // namespace

Region parseRegion(const std::string& text) {
  const auto colon = text.find(':');
  const std::string kind = text.substr(0, colon), rest = colon == std::string::npos ? "" : text.substr(colon + 1);
  if (kind == "box") {
    const std::vector<double> n = parseNumbers("--remove", rest, {6}, "box:X0,Y0,Z0,X1,Y1,Z1");
    return Region::box({n[0], n[1], n[2]}, {n[3], n[4], n[5]});
  }
  if (kind == "mesh" && !rest.empty()) return meshRegion(rest);
  if (kind == "ids") return pointsRegion(rest);
  throw InvalidArgument("usage.remove", "--remove", "\"" + text + "\" is not a region",
                        std::string("Use ") + kRegionForms);
}

RemovedAs parseRemovedAs(const std::string& text) {
  if (text == "unknown") return RemovedAs::Unknown;
  if (text == "free") return RemovedAs::Free;
  throw InvalidArgument("usage.removed_as", "--removed-as", "\"" + text + "\" is neither unknown nor free",
                        "Use unknown, and scan again, or free if you saw that nothing is left");
}

std::vector<Segment> readSegments(const std::string& path, const AccessibilityField& field, Messages& messages) {
  std::string extension = fs::path(path).extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (extension != ".ply") {
    std::vector<Segment> segments;
    for (const io::NamedBox& box : io::readBoxes(path)) {
      segments.push_back({box.name, Region::box(box.min_W, box.max_W)});
    }
    return segments;
  }
  const io::LabelledCloud cloud = io::readLabelledCloud(path);
  LabelledSegments found = segmentsOf(field, cloud.positions_W, cloud.segments);
  if (found.segments.empty()) {
    throw UnusableInput("segments.none", path, "none of its points with a segment is near a point of the map",
                        "Give the cloud in the map's world frame, in metres, with segments above 0");
  }
  messages.notice(std::to_string(found.segments.size()) + " segments; of " + std::to_string(cloud.segments.size()) +
                  " points, " + std::to_string(found.unlabelled) + " without a segment and " +
                  std::to_string(found.unmatched) + " far from every point of the map");
  return std::move(found.segments);
}

}  // namespace accessvdb::tools
