// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What is inside any .vdb file. Trees are read in a child process: a crash there is a message here.
#include <openvdb/tools/Count.h>

#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "io/results/vdb_reading.h"
#include "io/streams/guarded_child.h"
#include "io/streams/input_file.h"
#include "vdb/standard_grids.h"

namespace accessvdb::internal {

std::uint64_t checkVdbFile(const std::filesystem::path& path) {
  if (!io::isThere(path)) {
    throw InputError("input.missing", path.string(), "no such file", "Check the path");
  }
  if (!io::isFile(path)) {
    throw InputError("input.not_a_file", path.string(), "is not a regular file", "Use a .vdb file");
  }
  std::ifstream stream(path, std::ios::binary);
  if (!stream) throw InputError("input.unreadable", path.string(), "cannot be opened", "Check its permissions");
  std::int64_t magic = 0;
  if (!stream.read(reinterpret_cast<char*>(&magic), sizeof(magic)) || magic != openvdb::OPENVDB_MAGIC) {
    throw InputError("input.not_vdb", path.string(), "is not an OpenVDB file", "Use a .vdb file");
  }
  return io::inputFileSize(path);
}

ChildLimits limitsForVdb(std::uint64_t file_bytes) {
  constexpr std::uint64_t kSlowestBytesPerSecond = 10'000'000;
  constexpr std::chrono::seconds kLeastTime{10};    // damage can make OpenVDB loop for hours
  constexpr std::uint64_t kMemoryPerFileByte = 64;  // our sparse float grids: 10 to 30
  ChildLimits limits;
  limits.time = kLeastTime + std::chrono::seconds(file_bytes / kSlowestBytesPerSecond);
  limits.extra_memory_bytes += file_bytes * kMemoryPerFileByte;
  return limits;
}

std::string clampedText(const std::string& text) {
  constexpr std::size_t kMaxChars = 200;
  std::string clamped = text.substr(0, kMaxChars);
  for (char& c : clamped) {
    if (static_cast<unsigned char>(c) < 0x20 || static_cast<unsigned char>(c) > 0x7e) c = '?';
  }
  while (!clamped.empty() && (clamped.back() == '.' || clamped.back() == ' ')) clamped.pop_back();
  return text.size() > kMaxChars ? clamped + "..." : clamped;
}

}  // namespace accessvdb::internal

namespace accessvdb::io {
namespace {

using nlohmann::json;
using Pairs = std::vector<std::pair<std::string, std::string>>;

Pairs pairsOf(const openvdb::MetaMap& map) {
  Pairs pairs;
  for (auto it = map.beginMeta(); it != map.endMeta(); ++it) {
    if (it->second) pairs.emplace_back(it->first, it->second->str());
  }
  return pairs;
}

/// Empties the grid at the end: see runInChild().
json summaryOf(openvdb::GridBase& grid) {
  json summary;
  summary["name"] = grid.getName();
  summary["type"] = grid.type();
  summary["class"] = openvdb::GridBase::gridClassToString(grid.getGridClass());
  summary["creator"] = grid.getCreator();
  const openvdb::Vec3d voxel = grid.voxelSize();
  for (int axis = 0; axis < 3; ++axis) summary["voxel"].push_back(std::isfinite(voxel[axis]) ? voxel[axis] : 0.0);
  openvdb::CoordBBox box(openvdb::Coord(0), openvdb::Coord(0));
  const bool known = grid.apply<openvdb::GridTypes>([&](auto& typed) {
    auto& tree = typed.tree();
    if (!tree.evalActiveVoxelBoundingBox(box)) box = openvdb::CoordBBox(openvdb::Coord(0), openvdb::Coord(0));
    summary["voxels"] = openvdb::tools::countActiveVoxels(tree, /*threaded=*/false);
    summary["leaves"] = tree.leafCount();
    summary["bytes"] = openvdb::tools::memUsage(tree, /*threaded=*/false);
    tree.root().clear();
  });
  if (!known) throw std::runtime_error("grid '" + grid.getName() + "' has the unknown type " + grid.type());
  summary["min"] = {box.min().x(), box.min().y(), box.min().z()};
  summary["max"] = {box.max().x(), box.max().y(), box.max().z()};
  summary["metadata"] = pairsOf(grid);
  return summary;
}

/// Reads grids one at a time, so that a file of many grids does not need the memory of all.
std::string summariseInChild(const std::filesystem::path& path) {
  openvdb::initialize();
  openvdb::io::File& file = *new openvdb::io::File(path.string());  // never freed: see runInChild()
  file.open(false);
  json summary = {{"grids", json::array()}};
  if (const auto metadata = file.getMetadata()) summary["metadata"] = pairsOf(*metadata);
  for (auto it = file.beginName(); it != file.endName(); ++it) {
    const openvdb::GridBase::Ptr grid = file.readGrid(it.gridName());
    if (grid) summary["grids"].push_back(summaryOf(*grid));
  }
  return summary.dump(-1, ' ', false, json::error_handler_t::replace);
}

GridSummary gridFrom(const json& from) {
  GridSummary grid;
  grid.name = from.at("name");
  grid.type = from.at("type");
  grid.grid_class = from.at("class");
  grid.active_voxels = from.at("voxels");
  grid.leaves = from.at("leaves");
  grid.bytes = from.at("bytes");
  grid.min_ijk = from.at("min");
  grid.max_ijk = from.at("max");
  const std::array<double, 3> voxel = from.at("voxel");
  grid.voxel_size_m = {voxel[0], voxel[1], voxel[2]};
  grid.metadata = from.at("metadata").get<Pairs>();
  return grid;
}

}  // namespace

VdbSummary summarizeVdb(const std::filesystem::path& path) {
  const auto limits = internal::limitsForVdb(internal::checkVdbFile(path));
  const auto result = internal::runInChild(limits, [&path] { return summariseInChild(path); });
  if (!result.ok) {
    throw InputError("input.damaged_vdb", path.string(),
                     "is damaged or of an unknown kind (" + internal::clampedText(result.text) + ")",
                     "Write it again with the program that made it");
  }
  const json parsed = json::parse(result.text);
  VdbSummary summary;
  if (parsed.contains("metadata")) summary.metadata = parsed["metadata"].get<Pairs>();
  // OpenVDB keeps the creator on each grid, Houdini at file level.
  for (const auto& [name, text] : summary.metadata) {
    if (name == "creator") summary.creator = text;
  }
  for (const json& grid : parsed.at("grids")) {
    summary.grids.push_back(gridFrom(grid));
    if (summary.creator.empty()) summary.creator = grid.at("creator");
  }
  return summary;
}

}  // namespace accessvdb::io

namespace accessvdb::internal {
namespace {

/// "Tree_float_5_4_3" as "float"; other names stay unchanged.
std::string valueTypeOf(const std::string& grid_type) {
  const std::string prefix = "Tree_";
  if (grid_type.rfind(prefix, 0) != 0) return grid_type;
  const auto end = grid_type.find('_', prefix.size());
  return end == std::string::npos ? grid_type : grid_type.substr(prefix.size(), end - prefix.size());
}

}  // namespace

std::string vdbInWords(const std::filesystem::path& path) try {
  const io::VdbSummary summary = io::summarizeVdb(path);
  if (summary.grids.empty()) return "no grids";
  const io::GridSummary& first = summary.grids.front();
  const std::string type = valueTypeOf(first.type);
  const std::string kind = type == "ptdataidx32" ? "points" : first.grid_class == "unknown" ? "grid" : first.grid_class;
  std::string words = kind + " \"" + first.name + "\" (" + type + ")";
  if (summary.grids.size() > 1) words += " and " + std::to_string(summary.grids.size() - 1) + " more";
  if (!summary.creator.empty()) words += ", by " + summary.creator;
  return clampedText(words);
} catch (const InputError& error) {
  return "an OpenVDB file that cannot be read: " + error.problem();
}

}  // namespace accessvdb::internal
