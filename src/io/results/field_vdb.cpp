// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// field.vdb: the surface as fogs, attributes and, if requested, a level set, and the map itself. Float, bool and vec3s
/// grids only.
#include <algorithm>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>

#include "accessvdb/tsdf_volume.h"
#include "io/results/field_grids.h"
#include "io/results/held_roll.h"
#include "io/results/points_ply.h"
#include "io/results/program_version.h"
#include "io/results/surface_level_set.h"
#include "io/results/surface_voxels.h"

namespace accessvdb::internal {
namespace {

constexpr float kScoreOfNone = -1.0f;

bool keepAll(const SurfacePoint&) { return true; }

/// What a grid's metadata says. Its words are part of the file's bytes.
struct GridNotes {
  openvdb::GridClass grid_class;
  const char* unit;  ///< of the grid's values
  const char* description;
  bool may_be_half;  ///< counts may not: a half has 11 bits and ends at 65504
};

/// The grids of field.vdb for one field and one set of options.
class FieldGrids {
 public:
  /// What a field has besides.
  struct Kind {
    bool rolls = false;              ///< the tool rolls
    std::vector<std::string> tools;  ///< names of several
    bool margins = false;            ///< some of them are grown
  };
  FieldGrids(const VolumeGrids& volume, const SurfacePoints& points, const io::WriteOptions& options, Kind kind)
      : volume_(volume), points_(points), options_(options), kind_(std::move(kind)), surface_(points) {}
  [[nodiscard]] std::vector<LazyGrid> list() const;

 private:
  /// Sets name, class, frame and meaning on the grid itself: Houdini shows these and drops file-level metadata.
  template <typename GridPtr>
  [[nodiscard]] openvdb::GridBase::Ptr described(const GridPtr& grid, const GridNotes& notes) const {
    grid->setGridClass(notes.grid_class);
    grid->setTransform(fieldTransform(points_.voxel_size_m(), options_.up_axis));
    grid->setSaveFloatAsHalf(options_.half_float && notes.may_be_half);
    grid->insertMeta("description", openvdb::StringMetadata(notes.description));
    grid->insertMeta("value_unit", openvdb::StringMetadata(notes.unit));
    grid->insertMeta("length_unit", openvdb::StringMetadata("m"));
    grid->insertMeta("up_axis", openvdb::StringMetadata(name(options_.up_axis)));
    grid->insertMeta("origin_W_x", openvdb::DoubleMetadata(points_.origin_W().x()));
    grid->insertMeta("origin_W_y", openvdb::DoubleMetadata(points_.origin_W().y()));
    grid->insertMeta("origin_W_z", openvdb::DoubleMetadata(points_.origin_W().z()));
    grid->insertMeta("accessvdb_version", openvdb::StringMetadata(programVersion()));
    return grid;
  }

  template <typename Keep>
  [[nodiscard]] LazyGrid fog(const std::string& name, const Keep& keep, const char* description) const {
    return {name, [this, name, keep, description] {
              const auto one = [](const SurfacePoint&, std::uint32_t) { return 1.0f; };
              return described(surface_.grid<openvdb::FloatGrid>(name, 0.0f, keep, one),
                               {openvdb::GRID_FOG_VOLUME, "1", description, true});
            }};
  }

  [[nodiscard]] openvdb::GridBase::Ptr confidence() const;
  [[nodiscard]] openvdb::GridBase::Ptr score() const;
  [[nodiscard]] openvdb::GridBase::Ptr bestDirection() const;
  [[nodiscard]] openvdb::GridBase::Ptr bestRoll() const;
  [[nodiscard]] openvdb::GridBase::Ptr bestTool() const;
  [[nodiscard]] openvdb::GridBase::Ptr margin() const;

  const VolumeGrids& volume_;
  const SurfacePoints& points_;
  const io::WriteOptions options_;
  Kind kind_;
  const SurfaceVoxels surface_;
};

openvdb::GridBase::Ptr FieldGrids::confidence() const {
  const auto value = [](const SurfacePoint& point, std::uint32_t) { return point.confidence; };
  return described(surface_.grid<openvdb::FloatGrid>("confidence", 0.0f, keepAll, value),
                   {openvdb::GRID_UNKNOWN, "1", "confidence of each surface voxel, 0 up to below 1", true});
}

openvdb::GridBase::Ptr FieldGrids::score() const {
  const auto value = [](const SurfacePoint& point, std::uint32_t) {
    return point.score == kNoScore ? kScoreOfNone : static_cast<float>(point.score);
  };
  return described(surface_.grid<openvdb::FloatGrid>("score", kScoreOfNone, keepAll, value),
                   {openvdb::GRID_UNKNOWN, "collisions",
                    "fewest collisions of the tool in any direction; -1 where none was scored", false});
}

openvdb::GridBase::Ptr FieldGrids::bestDirection() const {
  const auto keep = [](const SurfacePoint& point) { return !point.direction_W.isZero(); };
  const auto value = [up = options_.up_axis](const SurfacePoint& point, std::uint32_t) {
    return toFileFrame(point.direction_W, up);
  };
  auto grid = surface_.grid<openvdb::Vec3SGrid>("best_direction", openvdb::Vec3s(0.0f), keep, value);
  grid->setVectorType(openvdb::VEC_CONTRAVARIANT_RELATIVE);
  return described(grid, {openvdb::GRID_UNKNOWN, "1",
                          "unit vector outwards along the tool's body; the tool travels against it", true});
}

openvdb::GridBase::Ptr FieldGrids::bestRoll() const {
  const auto keep = [](const SurfacePoint& point) { return !point.direction_W.isZero(); };
  const auto value = [](const SurfacePoint& point, std::uint32_t) {
    return static_cast<float>(rollOf(point.orientation_WT) * kDegreesPerRadian);
  };
  return described(
      surface_.grid<openvdb::FloatGrid>("best_roll", 0.0f, keep, value),
      {openvdb::GRID_UNKNOWN, "degrees",
       "how far the tool is turned about its body, 0 up to below 360; 0: its top as far up as it goes", false});
}

openvdb::GridBase::Ptr FieldGrids::bestTool() const {
  constexpr float kNoTool = -1.0f;
  const auto value = [](const SurfacePoint& point, std::uint32_t) { return static_cast<float>(point.tool); };
  return described(surface_.grid<openvdb::FloatGrid>("best_tool", kNoTool, keepAll, value),
                   {openvdb::GRID_UNKNOWN, "index",
                    "first tool that reaches the voxel, from 0; where none does, the one that came closest", false});
}

openvdb::GridBase::Ptr FieldGrids::margin() const {
  constexpr float kNoMargin_m = -1.0f;
  const auto keep = [](const SurfacePoint& point) { return point.margin_m >= 0; };
  const auto value = [](const SurfacePoint& point, std::uint32_t) { return point.margin_m; };
  return described(
      surface_.grid<openvdb::FloatGrid>("margin_m", kNoMargin_m, keep, value),
      {openvdb::GRID_UNKNOWN, "m", "largest margin around the tool with which it still reaches the voxel", false});
}

std::vector<LazyGrid> FieldGrids::list() const {
  const auto labelled = [](PointLabel label) {
    return [label](const SurfacePoint& point) { return point.label == label; };
  };
  std::vector<LazyGrid> grids;
  grids.push_back(fog("density", keepAll, "1 in every voxel that holds a surface point"));
  grids.push_back(fog("accessible", labelled(PointLabel::Accessible), "1 in surface voxels that the tool can reach"));
  grids.push_back(fog("blocked", labelled(PointLabel::Blocked), "1 in surface voxels that the tool cannot reach"));
  grids.push_back({"confidence", [this] { return confidence(); }});
  grids.push_back({"score", [this] { return score(); }});
  grids.push_back({"best_direction", [this] { return bestDirection(); }});
  if (kind_.rolls) grids.push_back({"best_roll", [this] { return bestRoll(); }});
  if (!kind_.tools.empty()) grids.push_back({"best_tool", [this] { return bestTool(); }});
  if (kind_.margins) grids.push_back({"margin_m", [this] { return margin(); }});
  for (std::size_t k = 0; k < kind_.tools.size(); ++k) {
    const auto reached = [k](const SurfacePoint& point) { return (point.tools >> k & 1) != 0; };
    grids.push_back(fog("accessible_" + kind_.tools[k], reached, "1 in surface voxels that this tool can reach"));
  }
  grids.push_back({"distance", [this] {
                     return described(
                         volume_.distance(),
                         {openvdb::GRID_UNKNOWN, "m",
                          "mean of the clamped signed distances, metres; no level set: no zero crossing", true});
                   }});
  grids.push_back({"weight", [this] {
                     return described(volume_.weight(),
                                      {openvdb::GRID_UNKNOWN, "observations", "observations of each voxel", false});
                   }});
  grids.push_back({"cleared", [this] {
                     return described(volume_.cleared(), {openvdb::GRID_UNKNOWN, "1",
                                                          "true where a ray passed on its way to a return", false});
                   }});
  if (options_.surface) {
    grids.push_back({"surface", [this] {
                       return described(
                           surfaceLevelSet(points_, surface_),
                           {openvdb::GRID_LEVEL_SET, "m",
                            "signed distance to the surface points, positive on the side they were seen from", true});
                     }});
  }
  return grids;
}

}  // namespace

void writeFieldGrids(const std::filesystem::path& path, const VolumeGrids& volume, const SurfacePoints& points,
                     const io::FieldMetadata& metadata, const io::WriteOptions& options) {
  openvdb::initialize();
  FieldGrids::Kind kind;
  for (const auto& [name, text] : metadata) {
    kind.rolls = kind.rolls || name == "rolls";
    kind.margins = kind.margins || name == "margins_m";
    if (name != "tools") continue;
    std::istringstream names(text);
    for (std::string tool; std::getline(names, tool, ',');) kind.tools.push_back(tool);
  }
  const FieldGrids grids(volume, points, options, std::move(kind));
  const auto file_metadata = fieldMetadata(points, metadata, options);
  io::writeFileDurably(path, [&](std::ostream& stream) {
    writeGrids(stream, grids.list(), file_metadata, options.compression, options.full_bytes);
  });
}

}  // namespace accessvdb::internal

namespace accessvdb::io {

void writeFieldVdb(const std::filesystem::path& path, const TsdfVolume& volume, const SurfacePoints& points,
                   const FieldMetadata& metadata, const WriteOptions& options) {
  const internal::VolumeGrids grids = {[&] { return volume.distance(); }, [&] { return volume.weight(); },
                                       [&] { return volume.cleared(); }};
  internal::writeFieldGrids(path, grids, points, metadata, options);
}

void writeFieldVdb(const std::filesystem::path& path, const TsdfVolume& volume, const FieldSnapshot& field,
                   const FieldMetadata& metadata, const WriteOptions& options) {
  writeFieldVdb(path, volume, SnapshotPoints(field), metadata, options);
}

void writeFieldVdb(const std::filesystem::path& path, const TsdfVolume& volume, const FieldSnapshot& field,
                   const FieldMetadata& metadata) {
  writeFieldVdb(path, volume, field, metadata, {});
}

}  // namespace accessvdb::io
