// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Grids to a stream one after the other, with OpenVDB's own archive code.
///
/// io::File::write and io::Stream::write want all grids at once. A field of nine grids is built grid by grid instead,
/// so the peak holds the largest one, not the sum.
#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>

#include <ostream>
#include <set>

#include "accessvdb/config.h"
#include "io/field_grids.h"

namespace accessvdb::internal {
namespace {

class GridArchive : public openvdb::io::Archive {
 public:
  GridArchive() {
    // What OpenVDB itself writes by default, and what Blender, Houdini and the Python module open.
    setCompression(DEFAULT_COMPRESSION_FLAGS);
    setGridStatsMetadataEnabled(true);
  }
  [[nodiscard]] openvdb::io::Archive::Ptr copy() const override { return std::make_shared<GridArchive>(*this); }

  void writeAll(std::ostream& stream, const std::vector<LazyGrid>& grids, const openvdb::MetaMap& metadata) const {
    // With offsets a reader can fetch one grid by name without reading the others.
    const bool seekable = stream.tellp() != std::ostream::pos_type(-1);
    auto stream_metadata = std::make_shared<openvdb::io::StreamMetadata>();
    openvdb::io::setStreamMetadataPtr(stream, stream_metadata, false);
    writeHeader(stream, seekable);
    metadata.writeMeta(stream);
    const auto count = static_cast<openvdb::Int32>(grids.size());
    stream.write(reinterpret_cast<const char*>(&count), sizeof(count));
    for (const LazyGrid& lazy : grids) {
      const openvdb::GridBase::Ptr grid = lazy.make();
      grid->setName(lazy.name);
      grid->setCreator("AccessVDB " ACCESSVDB_VERSION);
      openvdb::io::GridDescriptor descriptor(lazy.name, grid->type(), false);
      writeGrid(descriptor, grid, stream, seekable);
    }
    openvdb::io::clearStreamMetadataPtr(stream);
  }
};

}  // namespace

void writeGrids(std::ostream& stream, const std::vector<LazyGrid>& grids, const openvdb::MetaMap& metadata) {
  openvdb::initialize();
  GridArchive().writeAll(stream, grids, metadata);
}

openvdb::MetaMap fieldMetadata(const FieldSnapshot& field, const io::FieldMetadata& metadata) {
  openvdb::MetaMap map;
  for (const auto& [name, text] : metadata) {
    if (!name.empty()) map.insertMeta(name, openvdb::StringMetadata(text));
  }
  const auto replace = [&map](const std::string& name, const openvdb::Metadata& value) {
    map.removeMeta(name);  // insertMeta refuses a value of another type
    map.insertMeta(name, value);
  };
  replace("creator", openvdb::StringMetadata("AccessVDB " ACCESSVDB_VERSION));
  replace("accessvdb_version", openvdb::StringMetadata(ACCESSVDB_VERSION));
  replace("origin_W_x", openvdb::DoubleMetadata(field.origin_W.x()));
  replace("origin_W_y", openvdb::DoubleMetadata(field.origin_W.y()));
  replace("origin_W_z", openvdb::DoubleMetadata(field.origin_W.z()));
  replace("voxel_size_m", openvdb::DoubleMetadata(field.voxel_size_m));
  return map;
}

}  // namespace accessvdb::internal
