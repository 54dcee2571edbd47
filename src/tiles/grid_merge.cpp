// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One field.vdb from those of all tiles. Cores end at faces of leaves, so the grids of the map are joined leaf by
/// leaf; those of the points are made again from the merged points, in their order.
#include <tbb/task_arena.h>

#include "accessvdb/error.h"
#include "accessvdb/surface_points.h"
#include "accessvdb/tiles.h"
#include "field/thread_count.h"
#include "io/results/field_grids.h"
#include "tiles/point_file.h"
#include "tiles/tile_files.h"
#include "vdb/standard_grids.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void failDamaged(const fs::path& path) {
  throw InputError("tile.damaged", path.string(), "cannot be read",
                   "Delete its folder and run accessvdb tile run again");
}

openvdb::GridBase::Ptr readGrid(const fs::path& path, const std::string& name) {
  try {
    openvdb::io::File file(path.string());
    file.open(/*delayLoad=*/false);
    return file.readGrid(name);
  } catch (const openvdb::Exception&) {
    failDamaged(path);
  }
}

/// Moves the leaves of a tile's grid into the grid of all.
template <typename GridT>
typename GridT::Ptr joined(const fs::path& out, const std::vector<Tile>& tiles, const char* name) {
  typename GridT::Ptr all;
  for (const Tile& tile : tiles) {
    const fs::path path = tileFolder(out, tile.id) / kGridsFile;
    const auto grid = openvdb::gridPtrCast<GridT>(readGrid(path, name));
    if (!grid) failDamaged(path);
    if (!all) all = GridT::create(grid->background());
    std::vector<typename GridT::TreeType::LeafNodeType*> leaves;
    grid->tree().stealNodes(leaves);
    for (auto* leaf : leaves) all->tree().addLeaf(leaf);
  }
  all->setName(name);
  return all;
}

}  // namespace

void mergeGrids(const GridMerge& merge) {
  for (const Tile& tile : merge.tiles) {
    // A damaged .vdb may be read without complaint, or never come to an end.
    openOf(merge.out, tile, kGridsFile, std::size_t{1} << 20).skipToEnd();
  }
  openvdb::initialize();
  HashedFile first = openOf(merge.out, merge.tiles.front(), kPointsFile, std::size_t{1} << 16);
  io::FieldMetadata metadata = readHeader(first).metadata();
  for (auto& [name, text] : metadata) {
    if (name == "device") text = deviceOf(merge.tiles);
  }
  const FieldSnapshot points = io::readPointsPly(merge.points);
  const internal::VolumeGrids grids = {[&] { return joined<openvdb::FloatGrid>(merge.out, merge.tiles, "distance"); },
                                       [&] { return joined<openvdb::FloatGrid>(merge.out, merge.tiles, "weight"); },
                                       [&] { return joined<openvdb::BoolGrid>(merge.out, merge.tiles, "cleared"); }};
  internal::requireThreads(merge.threads);
  tbb::task_arena arena(merge.threads > 0 ? merge.threads : static_cast<int>(tbb::task_arena::automatic));
  arena.execute([&] { internal::writeFieldGrids(merge.file, grids, SnapshotPoints(points), metadata, merge.files); });
}

}  // namespace accessvdb::tiles
