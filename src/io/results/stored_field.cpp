// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Queries to a map on disk: points.ply for the surface, field.vdb for the volume.
#include <cmath>
#include <limits>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/output_check.h"
#include "accessvdb/program/path_facts.h"
#include "io/results/surface_voxels.h"
#include "io/results/vdb_reading.h"

namespace accessvdb::io {
namespace {

constexpr int kSearchVoxels = 3;
constexpr const char* kAdvice = "Use the output folder of an accessvdb map run";

struct MapGrids {
  openvdb::FloatGrid::Ptr distance, weight;
  openvdb::BoolGrid::Ptr cleared;
  Eigen::Vector3d origin_W;
  double voxel_size_m = 0;
};

double numberOf(const openvdb::MetaMap& metadata, const std::string& name) {
  const auto value = metadata.getMetadata<openvdb::DoubleMetadata>(name);
  if (!value || !std::isfinite(value->value())) throw std::runtime_error("no number '" + name + "' in its metadata");
  return value->value();
}

template <typename GridT>
typename GridT::Ptr gridOf(openvdb::io::File& file, const std::string& name, double voxel_size_m, UpAxis up) {
  if (!file.hasGrid(name)) throw std::runtime_error("no grid '" + name + "'");
  auto grid = openvdb::gridPtrCast<GridT>(file.readGrid(name));
  if (!grid) throw std::runtime_error("grid '" + name + "' has another type");
  if (grid->transform() != *internal::fieldTransform(voxel_size_m, up)) {
    throw std::runtime_error("grid '" + name + "' has a transform that does not match its voxel size and up axis");
  }
  return grid;
}

/// The files of a map with y up differ only in their transforms; voxel indices, which are used here, are the same.
UpAxis upAxisOf(const openvdb::MetaMap& metadata) {
  const auto word = metadata.getMetadata<openvdb::StringMetadata>("up_axis");
  if (!word || word->value() == internal::name(UpAxis::Z)) return UpAxis::Z;  // absent in files older than the option
  if (word->value() == internal::name(UpAxis::Y)) return UpAxis::Y;
  throw std::runtime_error("its up axis '" + word->value() + "' is neither z nor y");
}

MapGrids readGrids(const std::filesystem::path& path) {
  openvdb::initialize();
  openvdb::io::File file(path.string());
  file.open(false);  // no delayed loading: a file that shrinks later must not raise SIGBUS
  MapGrids grids;
  const auto metadata = file.getMetadata();
  if (!metadata || !(*metadata)["accessvdb_version"]) throw std::runtime_error("it was not written by AccessVDB");
  grids.voxel_size_m = numberOf(*metadata, "voxel_size_m");
  grids.origin_W = {numberOf(*metadata, "origin_W_x"), numberOf(*metadata, "origin_W_y"),
                    numberOf(*metadata, "origin_W_z")};
  if (!(grids.voxel_size_m > 0)) throw std::runtime_error("its voxel size is not positive");
  const UpAxis up = upAxisOf(*metadata);
  grids.distance = gridOf<openvdb::FloatGrid>(file, "distance", grids.voxel_size_m, up);
  grids.weight = gridOf<openvdb::FloatGrid>(file, "weight", grids.voxel_size_m, up);
  grids.cleared = gridOf<openvdb::BoolGrid>(file, "cleared", grids.voxel_size_m, up);
  return grids;
}

[[noreturn]] void throwNotAField(const std::filesystem::path& path, const std::string& why) {
  throw InputError("input.not_a_field", path.string(), "contains no field (" + internal::clampedText(why) + ")",
                   kAdvice);
}

/// A file was given instead of a folder: reports what kind of file it is.
[[noreturn]] void throwFileNotFolder(const std::filesystem::path& file) {
  try {
    static_cast<void>(internal::checkVdbFile(file));
  } catch (const InputError& error) {
    throw InputError("input.not_a_folder", file.string(), "is not a folder, and " + error.problem(), kAdvice);
  }
  throw InputError("input.not_a_folder", file.string(),
                   "is a .vdb file (" + internal::vdbInWords(file) + "), but queries need the whole folder", kAdvice);
}

/// Reads twice: first where a crash does no harm, then here.
MapGrids readGridsGuarded(const std::filesystem::path& path) {
  const auto limits = internal::limitsForVdb(internal::checkVdbFile(path));
  const auto trial = internal::runInChild(limits, [&path] {
    static_cast<void>(new MapGrids(readGrids(path)));  // never freed: see runInChild()
    return std::string();
  });
  if (!trial.ok) throwNotAField(path, trial.text + "; it contains " + internal::vdbInWords(path));
  try {
    return readGrids(path);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    throwNotAField(path, error.what());
  }
}

}  // namespace

struct ACCESSVDB_PRIVATE StoredField::Impl {
  FieldSnapshot field;
  MapGrids map;
  openvdb::Int32Grid::Ptr point_of_voxel;  ///< index + 1 of the point, 0 = none
};

StoredField::StoredField(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
StoredField::~StoredField() = default;
StoredField::StoredField(StoredField&&) noexcept = default;

StoredField StoredField::open(const std::filesystem::path& folder) {
  OutputCheck check;
  return open(folder, check);
}

StoredField StoredField::open(const std::filesystem::path& folder, OutputCheck& check) {
  if (isFile(folder)) throwFileNotFolder(folder);
  if (!isFolder(folder)) {
    throw InputError("input.missing", folder.string(), "no such folder", kAdvice);
  }
  for (const char* name : {"field.vdb", "points.ply"}) {
    if (!isThere(folder / name)) {
      const bool is_state = isThere(folder / "state.json");
      throw InputError("input.not_a_field", folder.string(), std::string("contains no ") + name,
                       is_state ? "It holds a saved state: name the folder of results of the same map" : kAdvice);
    }
  }
  auto impl = std::make_unique<Impl>();
  check.begin(folder, {"points.ply", "field.vdb"});
  // The hash of the grids is known before they are read: OpenVDB takes many damaged ones without complaint.
  impl->field = readChecked(check, [&] { return readPointsPly(folder / "points.ply"); });
  impl->map = readGridsGuarded(folder / "field.vdb");
  if (impl->map.origin_W != impl->field.origin_W || impl->map.voxel_size_m != impl->field.voxel_size_m) {
    throwNotAField(folder,
                   "field.vdb and points.ply have different origins or voxel sizes: they are from different runs");
  }
  const auto all = [](const SurfacePoint&) { return true; };
  const auto index = [](const SurfacePoint&, std::uint32_t i) { return static_cast<openvdb::Int32>(i + 1); };
  impl->point_of_voxel =
      internal::SurfaceVoxels(SnapshotPoints(impl->field)).grid<openvdb::Int32Grid>("points", 0, all, index);
  return StoredField(std::move(impl));
}

const FieldSnapshot& StoredField::points() const { return impl_->field; }

StoredField::Answer StoredField::at(const Eigen::Vector3d& p_W) const {
  const FieldSnapshot& field = impl_->field;
  const openvdb::Coord ijk = internal::voxelAt(p_W - field.origin_W, field.voxel_size_m);
  Answer answer;
  answer.position_W = p_W;
  const auto weight = impl_->map.weight->getConstAccessor();
  answer.observed = weight.isValueOn(ijk);
  answer.weight = weight.getValue(ijk);
  answer.distance_m = impl_->map.distance->getConstAccessor().getValue(ijk);
  answer.cleared = impl_->map.cleared->getConstAccessor().getValue(ijk);

  const auto points = impl_->point_of_voxel->getConstAccessor();
  const auto take = [&](openvdb::Int32 index_plus_1) {
    answer.point = field.points[static_cast<std::size_t>(index_plus_1 - 1)];
    answer.point_distance_m = (answer.point->position_W - p_W).norm();
    for (const AttributeColumn& column : field.attributes)
      answer.attributes.emplace_back(column.name, column.values[static_cast<std::size_t>(index_plus_1 - 1)]);
  };
  if (const auto own = points.getValue(ijk); own != 0) {
    take(own);
    return answer;
  }
  double nearest_m = kSearchVoxels * field.voxel_size_m;
  openvdb::Int32 nearest = 0;
  for (int dx = -kSearchVoxels; dx <= kSearchVoxels; ++dx) {
    for (int dy = -kSearchVoxels; dy <= kSearchVoxels; ++dy) {
      for (int dz = -kSearchVoxels; dz <= kSearchVoxels; ++dz) {
        const auto other = points.getValue(ijk.offsetBy(dx, dy, dz));
        if (other == 0) continue;
        const double d_m = (field.points[static_cast<std::size_t>(other - 1)].position_W - p_W).norm();
        if (d_m <= nearest_m) {
          nearest_m = d_m;
          nearest = other;
        }
      }
    }
  }
  if (nearest != 0) take(nearest);
  return answer;
}

}  // namespace accessvdb::io
