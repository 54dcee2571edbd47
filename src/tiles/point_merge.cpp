// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// One points.ply from those of all tiles. In one piece a point's number follows from the step that brought its first
/// return and from the place of its voxel, so tiles that are sorted by both merge into the one order.
#include <Eigen/Geometry>
#include <algorithm>
#include <cstring>
#include <functional>
#include <optional>
#include <ostream>
#include <queue>

#include "accessvdb/error.h"
#include "accessvdb/tiles.h"
#include "io/results/points_las.h"
#include "io/results/points_ply.h"
#include "tiles/point_file.h"
#include "tiles/tile_files.h"

namespace accessvdb::tiles {
namespace {

constexpr std::size_t kAllBlocksBytes = std::size_t{64} << 20;
constexpr std::size_t kLeastBlockBytes = std::size_t{4} << 10, kMostBlockBytes = std::size_t{1} << 20;

/// The points of a tile, one after the other.
class PointStream {
 public:
  PointStream(const std::filesystem::path& out, const Tile& tile, std::size_t block_bytes, bool with_firsts)
      : points_(openOf(out, tile, kPointsFile, block_bytes)),
        orders_(openOf(out, tile, kOrderFile, block_bytes)),
        header_(readHeader(points_)) {
    if (header_.points != tile.points) points_.fail();
    const auto named = [](const auto& file) { return file.first == kFirstFile; };
    if (with_firsts && std::any_of(tile.sha256.begin(), tile.sha256.end(), named)) {
      firsts_.emplace(openOf(out, tile, kFirstFile, block_bytes));
    }
  }

  [[nodiscard]] const TilePointsHeader& header() const { return header_; }
  [[nodiscard]] const PointOrder& order() const { return order_; }
  [[nodiscard]] const char* record() const { return record_; }
  [[nodiscard]] const std::optional<SurfacePoints::FirstReturn>& first() const { return first_; }

  /// @return false at the end
  [[nodiscard]] bool next() {
    record_ = points_.take(header_.columns.recordBytes());
    const char* order = orders_.take(sizeof(PointOrder));
    if ((record_ == nullptr) != (order == nullptr)) orders_.fail();
    const char* const stored = firsts_ ? firsts_->take(sizeof(StoredFirst)) : nullptr;
    if (firsts_ && (record_ == nullptr) != (stored == nullptr)) firsts_->fail();
    if (stored != nullptr) {
      StoredFirst first;
      std::memcpy(&first, stored, sizeof first);
      first_ = {first.gps_time, first.point_class};
    }
    if (record_ == nullptr) return false;
    const PointOrder before = order_;
    std::memcpy(&order_, order, sizeof order_);
    if (started_ && !(before < order_)) orders_.fail();
    started_ = true;
    return true;
  }

 private:
  HashedFile points_, orders_;
  std::optional<HashedFile> firsts_;
  std::optional<SurfacePoints::FirstReturn> first_;
  TilePointsHeader header_;
  PointOrder order_;
  const char* record_ = nullptr;
  bool started_ = false;
};

void writeHeader(std::ostream& stream, const TilePointsHeader& header, std::uint64_t points,
                 const std::string& device) {
  for (const std::string& line : header.lines) {
    if (line.starts_with("element vertex ")) {
      stream << "element vertex " << std::to_string(points);
    } else if (line.starts_with("comment device ")) {
      stream << "comment device " << device;
    } else {
      stream << line;
    }
    stream << "\n";
  }
}

internal::LasContent lasContent(const Plan& plan, const std::vector<Tile>& tiles, std::uint64_t points,
                                const std::vector<std::string>& carried) {
  Eigen::AlignedBox3d box;
  for (const Tile& tile : tiles) {
    if (tile.points == 0) continue;
    box.extend(Eigen::Vector3d(tile.min_W[0], tile.min_W[1], tile.min_W[2]));
    box.extend(Eigen::Vector3d(tile.max_W[0], tile.max_W[1], tile.max_W[2]));
  }
  return {{plan.origin_W[0], plan.origin_W[1], plan.origin_W[2]}, box.min(), box.max(), points, carried, plan.frame};
}

}  // namespace

std::uint64_t mergePoints(const std::filesystem::path& out, const Plan& plan, const std::vector<Tile>& tiles,
                          const std::filesystem::path& file) {
  if (tiles.empty()) {
    throw InputError("tile.missing", out.string(), "has no finished tile", "Run accessvdb tile run first");
  }
  const std::size_t block_bytes = std::clamp(kAllBlocksBytes / (2 * tiles.size()), kLeastBlockBytes, kMostBlockBytes);
  std::vector<PointStream> streams;
  std::uint64_t points = 0;
  for (const Tile& tile : tiles) {
    streams.emplace_back(out, tile, block_bytes, file.extension() == ".las");
    points += tile.points;
  }
  using Next = std::pair<PointOrder, std::size_t>;
  std::priority_queue<Next, std::vector<Next>, std::greater<>> queue;
  const auto advance = [&](std::size_t n) {
    if (streams[n].next()) queue.emplace(streams[n].order(), n);
  };
  for (std::size_t n = 0; n < streams.size(); ++n) advance(n);
  using First = std::optional<SurfacePoints::FirstReturn>;
  const auto forEachRecord = [&](const std::function<void(const char*, const First&)>& use) {
    while (!queue.empty()) {
      const std::size_t n = queue.top().second;
      queue.pop();
      use(streams[n].record(), streams[n].first());
      advance(n);
    }
  };
  const internal::PointsPlyColumns columns = streams.front().header().columns;
  for (const PointStream& tile : streams) {
    if (tile.header().columns == columns) continue;
    throw InputError("tile.damaged", out.string(),
                     "has tiles with and without orientations, rolls, tools, margins or probabilities",
                     "Delete the folder of its tiles and run accessvdb tile run again");
  }
  io::writeFileDurably(file, [&](std::ostream& stream) {
    if (file.extension() == ".las") {
      internal::LasContent content = lasContent(plan, tiles, points, streams.front().header().carried);
      content.margins = columns.margin;
      content.probability = columns.probability;
      internal::LasWriter writer(stream, content);
      std::vector<std::int32_t> carried(columns.carried);
      forEachRecord([&](const char* record, const First& first) {
        for (std::size_t c = 0; c < carried.size(); ++c) carried[c] = internal::carriedOfRecord(record, columns, c);
        writer.add(internal::pointOfRecord(record, columns), carried, first);
      });
    } else {
      writeHeader(stream, streams.front().header(), points, deviceOf(tiles));
      forEachRecord([&](const char* record, const First&) {
        stream.write(record, static_cast<std::streamsize>(columns.recordBytes()));
      });
    }
  });
  return points;
}

}  // namespace accessvdb::tiles
