// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Reading a tile's files from front to back, hashed on the way, so that a damaged one is noticed without a pass of its
/// own. A file is open only while a block of it is read: there may be more tiles than a process may have files open.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "accessvdb/tiles.h"
#include "io/results/points_ply.h"
#include "io/streams/sha256.h"

namespace accessvdb::tiles {

class HashedFile {
 public:
  /// @param sha256  what the whole file must have, lower-case hexadecimal  @param cure  what to do if it has not
  HashedFile(std::filesystem::path path, std::string sha256, std::string cure, std::size_t block_bytes);

  /// The next bytes, valid until the next call; nullptr at the end of the file, once its hash has been found right.
  /// @param bytes  at most block_bytes  @throws InputError "output.changed"
  [[nodiscard]] const char* take(std::size_t bytes);
  /// Up to the next line feed, without it. @throws InputError "output.changed"
  [[nodiscard]] std::string line();
  /// Reads the rest only to hash it. @throws InputError "output.changed"
  void skipToEnd();
  [[noreturn]] void fail() const;

 private:
  void refill();
  std::filesystem::path path_;
  std::string expected_, cure_;
  std::size_t block_bytes_;
  std::vector<char> buffer_;
  std::size_t begin_ = 0, end_ = 0;
  std::uint64_t offset_ = 0;  ///< of the file, after what is in the buffer
  bool finished_ = false;
  internal::Sha256 sha256_;
};

/// What points.ply says before its records.
struct TilePointsHeader {
  std::vector<std::string> lines;  ///< up to and including end_header
  std::uint64_t points = 0;
  internal::PointsPlyColumns columns;                ///< of its records
  std::vector<std::string> carried;                  ///< names of the last columns
  [[nodiscard]] io::FieldMetadata metadata() const;  ///< from its comments; without version, origin and voxel size
};
[[nodiscard]] TilePointsHeader readHeader(HashedFile& file);

/// Of the file in the tile's folder. What its manifest does not name is not as it was written.
[[nodiscard]] HashedFile openOf(const std::filesystem::path& out, const Tile& tile, const std::string& name,
                                std::size_t block_bytes);

/// Whether all files that the tile's manifest names are as they were written.
[[nodiscard]] bool isAsWritten(const std::filesystem::path& out, const Tile& tile);

/// What to do about a tile whose files are not as they were written.
[[nodiscard]] std::string cureOf(const std::filesystem::path& out, const TileId& id);

/// The text of `device` in merged files.
[[nodiscard]] std::string deviceOf(const std::vector<Tile>& tiles);

}  // namespace accessvdb::tiles
