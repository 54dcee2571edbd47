// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/point_file.h"

#include <algorithm>
#include <charconv>
#include <cstring>
#include <fstream>
#include <utility>

#include "accessvdb/error.h"
#include "tiles/tile_files.h"

namespace accessvdb::tiles {
namespace {

constexpr std::size_t kLongestHeader = std::size_t{1} << 20;
constexpr const char* kCountLine = "element vertex ";
constexpr const char* kComment = "comment ";
constexpr const char *kOrientationLine = "property ushort orientation", *kRollLine = "property uchar roll",
                     *kToolsLine = "property uint tools", *kMarginLine = "property float margin_m",
                     *kProbabilityLine = "property float access_probability";

}  // namespace

HashedFile::HashedFile(std::filesystem::path path, std::string sha256, std::string cure, std::size_t block_bytes)
    : path_(std::move(path)), expected_(std::move(sha256)), cure_(std::move(cure)), block_bytes_(block_bytes) {}

void HashedFile::fail() const {
  throw InputError("output.changed", path_.string(), "has changed since it was written, or is gone", cure_);
}

void HashedFile::refill() {
  std::copy(buffer_.begin() + static_cast<std::ptrdiff_t>(begin_), buffer_.begin() + static_cast<std::ptrdiff_t>(end_),
            buffer_.begin());
  end_ -= std::exchange(begin_, 0);
  buffer_.resize(block_bytes_);
  std::ifstream stream(path_, std::ios::binary);
  if (!stream || !stream.seekg(static_cast<std::streamoff>(offset_))) fail();
  stream.read(buffer_.data() + end_, static_cast<std::streamsize>(block_bytes_ - end_));
  const auto bytes = static_cast<std::size_t>(stream.gcount());
  sha256_.update(buffer_.data() + end_, bytes);
  end_ += bytes;
  offset_ += bytes;
  if (end_ == block_bytes_) return;
  finished_ = true;
  if (internal::hexOf(sha256_.digest()) != expected_) fail();
}

const char* HashedFile::take(std::size_t bytes) {
  if (end_ - begin_ < bytes && !finished_) refill();
  if (begin_ == end_) return nullptr;
  if (end_ - begin_ < bytes) fail();
  return buffer_.data() + std::exchange(begin_, begin_ + bytes);
}

void HashedFile::skipToEnd() {
  while (!finished_) {
    begin_ = end_;
    refill();
  }
}

std::string HashedFile::line() {
  std::string text;
  for (const char* next = take(1); next == nullptr || *next != '\n'; next = take(1)) {
    if (next == nullptr || text.size() > kLongestHeader) fail();
    text += *next;
  }
  return text;
}

TilePointsHeader readHeader(HashedFile& file) {
  TilePointsHeader header;
  std::size_t bytes = 0;
  do {
    header.lines.push_back(file.line());
    bytes += header.lines.back().size();
    if (bytes > kLongestHeader) file.fail();
    const std::string& text = header.lines.back();
    header.columns.orientation = header.columns.orientation || text == kOrientationLine;
    header.columns.roll = header.columns.roll || text == kRollLine;
    header.columns.tools = header.columns.tools || text == kToolsLine;
    header.columns.margin = header.columns.margin || text == kMarginLine;
    header.columns.probability = header.columns.probability || text == kProbabilityLine;
    if (text.starts_with(internal::kPointsPlyCarried))
      header.carried.push_back(text.substr(std::strlen(internal::kPointsPlyCarried)));
    if (text.starts_with(kCountLine)) {
      std::from_chars(text.data() + std::strlen(kCountLine), text.data() + text.size(), header.points);
    }
  } while (header.lines.back() != "end_header");
  header.columns.carried = header.carried.size();
  return header;
}

io::FieldMetadata TilePointsHeader::metadata() const {
  io::FieldMetadata metadata;
  for (const std::string& text : lines) {
    if (!text.starts_with(kComment)) continue;
    const std::size_t name = std::strlen(kComment), blank = text.find(' ', name);
    const std::string key = text.substr(name, blank - name);
    if (blank == std::string::npos || key == "AccessVDB" || key == "origin_W" || key == "voxel_size_m") continue;
    metadata.emplace_back(key, text.substr(blank + 1));
  }
  return metadata;
}

HashedFile openOf(const std::filesystem::path& out, const Tile& tile, const std::string& name,
                  std::size_t block_bytes) {
  const auto file =
      std::find_if(tile.sha256.begin(), tile.sha256.end(), [&](const auto& f) { return f.first == name; });
  return {tileFolder(out, tile.id) / name, file == tile.sha256.end() ? std::string() : file->second,
          cureOf(out, tile.id), block_bytes};
}

bool isAsWritten(const std::filesystem::path& out, const Tile& tile) {
  try {
    for (const auto& [name, sha256] : tile.sha256) openOf(out, tile, name, std::size_t{1} << 20).skipToEnd();
    return true;
  } catch (const InputError&) {
    return false;
  }
}

std::string cureOf(const std::filesystem::path& out, const TileId& id) {
  return "Make it again: tiles::run() of " + id.name() + " " + out.string();
}

std::string deviceOf(const std::vector<Tile>& tiles) {
  const bool same = std::all_of(tiles.begin(), tiles.end(), [&](const Tile& t) { return t.device == tiles[0].device; });
  return tiles.empty() || !same ? "mixed" : tiles[0].device;
}

}  // namespace accessvdb::tiles
