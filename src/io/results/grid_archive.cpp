// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Writes grids to a stream one after the other, with OpenVDB's own archive code.
///
/// io::File::write and io::Stream::write want all grids at once. A field of nine grids is built grid by grid instead,
/// so the peak holds the largest one, not the sum.
#include <openvdb/io/Archive.h>
#include <openvdb/io/GridDescriptor.h>
#include <openvdb/io/io.h>

#if defined(__linux__)
#include <malloc.h>
#endif

#include <cstdint>
#include <memory>
#include <ostream>
#include <set>
#include <sstream>
#include <streambuf>
#include <string>

#include "accessvdb/error.h"
#include "io/results/content_uuid.h"
#include "io/results/field_grids.h"
#include "io/results/program_version.h"
#include "io/results/surface_voxels.h"
#include "vdb/standard_grids.h"

namespace accessvdb::internal {
namespace {

/// From here on, giving the memory back is worth the milliseconds that it takes.
constexpr openvdb::Index64 kLargeGridBytes = 16 << 20;

/// The C library keeps the memory of a freed grid, in blocks that do not fit the next kind of grid: without this, the
/// copies that are written one after another would add up.
void giveFreedMemoryBack() {
#if defined(__GLIBC__)
  malloc_trim(0);
#endif
}

/// Counts what is written to it.
class CountingBuffer : public std::streambuf {
 public:
  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }

 private:
  int_type overflow(int_type c) override {
    ++bytes_;
    return traits_type::not_eof(c);
  }
  std::streamsize xsputn(const char*, std::streamsize count) override {
    bytes_ += static_cast<std::uint64_t>(count);
    return count;
  }
  std::uint64_t bytes_ = 0;
};

class GridArchive : public openvdb::io::Archive {
 public:
  explicit GridArchive(std::uint32_t compression_flags) {
    setCompression(compression_flags);
    setGridStatsMetadataEnabled(true);
  }
  [[nodiscard]] openvdb::io::Archive::Ptr copy() const override { return std::make_shared<GridArchive>(*this); }

  /// Gives the file a UUID made from its content. Where the stream cannot seek, it is made from the metadata alone.
  /// @param saved  if not null, by how many bytes the file is smaller than with 32-bit floats
  void writeAll(std::ostream& stream, const std::vector<LazyGrid>& grids, const openvdb::MetaMap& metadata,
                std::int64_t* saved) const {
    // With offsets a reader can fetch one grid by name without reading the others.
    const bool seekable = stream.tellp() != std::ostream::pos_type(-1);
    std::ostringstream made;
    writeHeader(made, seekable);
    std::string header = made.str();  // it ends with a random UUID
    const std::size_t uuid_at = header.size() >= kUuidLength ? header.size() - kUuidLength : 0;
    if (!isUuid(header.substr(uuid_at))) {
      throw InternalError("write.uuid", "OpenVDB", "writes a header that does not end with a UUID",
                          "Please report this with the version of OpenVDB");
    }
    header.resize(uuid_at);
    if (!seekable) {
      std::ostringstream text;
      metadata.writeMeta(text);
      Sha256 sha256;
      sha256.update(text.str().data(), text.str().size());
      stream << header << uuidOf(sha256.digest());
      writeBehindHeader(stream, grids, metadata, seekable, saved);
      return;
    }
    const std::ostream::pos_type begin = stream.tellp();
    stream << header << std::string(kUuidLength, '0');
    DigestBuffer buffer(*stream.rdbuf());
    std::ostream digested(&buffer);
    digested.exceptions(stream.exceptions());
    writeBehindHeader(digested, grids, metadata, seekable, saved);
    digested.flush();
    const std::ostream::pos_type end = stream.tellp();
    stream.seekp(begin + static_cast<std::streamoff>(uuid_at));
    stream << uuidOf(buffer.digest());
    stream.seekp(end);
  }

 private:
  static constexpr std::size_t kUuidLength = 36;

  void writeBehindHeader(std::ostream& stream, const std::vector<LazyGrid>& grids, const openvdb::MetaMap& metadata,
                         bool seekable, std::int64_t* saved) const {
    auto stream_metadata = std::make_shared<openvdb::io::StreamMetadata>();
    openvdb::io::setStreamMetadataPtr(stream, stream_metadata, false);
    // writeGrid() asks the stream, not the archive: box, voxel count and compression of each grid, for quick readers.
    openvdb::io::setWriteGridStatsMetadata(stream, isGridStatsMetadataEnabled());
    metadata.writeMeta(stream);
    const auto count = static_cast<openvdb::Int32>(grids.size());
    stream.write(reinterpret_cast<const char*>(&count), sizeof(count));
    for (const LazyGrid& lazy : grids) {
      openvdb::GridBase::Ptr grid = lazy.make();
      grid->setName(lazy.name);
      grid->setCreator("AccessVDB " + programVersion());
      openvdb::io::GridDescriptor descriptor(lazy.name, grid->type(), grid->saveFloatAsHalf());
      writeGrid(descriptor, grid, stream, seekable);
      if (saved != nullptr && grid->saveFloatAsHalf()) {
        const std::uint64_t half = bytesOf(lazy.name, grid);
        grid->setSaveFloatAsHalf(false);
        *saved += static_cast<std::int64_t>(bytesOf(lazy.name, grid)) - static_cast<std::int64_t>(half);
      }
      const bool is_large = grid->memUsage() >= kLargeGridBytes;
      grid.reset();
      if (is_large) giveFreedMemoryBack();
    }
    openvdb::io::clearStreamMetadataPtr(stream);
  }

  /// What it takes in a file.
  [[nodiscard]] std::uint64_t bytesOf(const std::string& name, const openvdb::GridBase::Ptr& grid) const {
    CountingBuffer buffer;
    std::ostream stream(&buffer);
    auto stream_metadata = std::make_shared<openvdb::io::StreamMetadata>();
    openvdb::io::setStreamMetadataPtr(stream, stream_metadata, false);
    openvdb::io::setWriteGridStatsMetadata(stream, isGridStatsMetadataEnabled());
    openvdb::io::GridDescriptor descriptor(name, grid->type(), grid->saveFloatAsHalf());
    writeGrid(descriptor, grid, stream, false);
    openvdb::io::clearStreamMetadataPtr(stream);
    return buffer.bytes();
  }
};

}  // namespace

std::uint32_t compressionFlags(io::Compression compression, bool has_blosc, bool has_zip) {
  using openvdb::io::COMPRESS_ACTIVE_MASK, openvdb::io::COMPRESS_BLOSC, openvdb::io::COMPRESS_NONE,
      openvdb::io::COMPRESS_ZIP;
  // The mask leaves out inactive values; it costs nothing, and every reader since 2013 knows it.
  const auto codec = [](bool has, const std::string& word, std::uint32_t flag) {
    if (!has) {
      throw InvalidArgument("write.compression", word, "the OpenVDB that this program uses was built without it",
                            "Use another compression, or none");
    }
    return flag | COMPRESS_ACTIVE_MASK;
  };
  switch (compression) {
    case io::Compression::Auto:
      break;
    case io::Compression::Blosc:
      return codec(has_blosc, "blosc", COMPRESS_BLOSC);
    case io::Compression::Zip:
      return codec(has_zip, "zip", COMPRESS_ZIP);
    case io::Compression::None:
      return COMPRESS_ACTIVE_MASK;
  }
  return COMPRESS_ACTIVE_MASK | (has_blosc ? COMPRESS_BLOSC : has_zip ? COMPRESS_ZIP : COMPRESS_NONE);
}

std::uint32_t compressionFlags(io::Compression compression) {
  return compressionFlags(compression, openvdb::io::Archive::hasBloscCompression(),
                          openvdb::io::Archive::hasZLibCompression());
}

void writeGrids(std::ostream& stream, const std::vector<LazyGrid>& grids, const openvdb::MetaMap& metadata,
                io::Compression compression, std::uint64_t* full_bytes) {
  openvdb::initialize();
  const std::ostream::pos_type begin = stream.tellp();
  std::int64_t saved = 0;
  GridArchive(compressionFlags(compression))
      .writeAll(stream, grids, metadata, full_bytes == nullptr ? nullptr : &saved);
  if (full_bytes != nullptr) *full_bytes = static_cast<std::uint64_t>(stream.tellp() - begin + saved);
}

openvdb::MetaMap fieldMetadata(const SurfacePoints& points, const io::FieldMetadata& metadata,
                               const io::WriteOptions& options) {
  openvdb::MetaMap map;
  for (const auto& [name, text] : metadata) {
    if (!name.empty()) map.insertMeta(name, openvdb::StringMetadata(text));
  }
  const auto replace = [&map](const std::string& name, const openvdb::Metadata& value) {
    map.removeMeta(name);  // insertMeta refuses a value of another type
    map.insertMeta(name, value);
  };
  replace("creator", openvdb::StringMetadata("AccessVDB " + programVersion()));
  replace("accessvdb_version", openvdb::StringMetadata(programVersion()));
  replace("origin_W_x", openvdb::DoubleMetadata(points.origin_W().x()));
  replace("origin_W_y", openvdb::DoubleMetadata(points.origin_W().y()));
  replace("origin_W_z", openvdb::DoubleMetadata(points.origin_W().z()));
  replace("voxel_size_m", openvdb::DoubleMetadata(points.voxel_size_m()));
  replace("length_unit", openvdb::StringMetadata("m"));
  replace("up_axis", openvdb::StringMetadata(name(options.up_axis)));
  return map;
}

}  // namespace accessvdb::internal

namespace accessvdb::io {

void checkWriteOptions(const WriteOptions& options) {
  static_cast<void>(internal::compressionFlags(options.compression));
}

}  // namespace accessvdb::io
