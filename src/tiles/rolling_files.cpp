// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/rolling_files.h"

#include <charconv>
#include <fstream>
#include <system_error>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tiles.h"
#include "io/streams/input_file.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr const char *kState = ".state", *kIds = ".ids";

fs::path fileOf(const fs::path& folder, const TileIndex& tile, std::uint64_t serial, const char* ending) {
  return folder / (TileId{tile.first, tile.second, {}}.name() + "." + std::to_string(serial) + ending);
}

}  // namespace

RollingFiles::RollingFiles(const fs::path& folder, const TileIndex& tile, std::uint64_t serial)
    : state(fileOf(folder, tile, serial, kState)), ids(fileOf(folder, tile, serial, kIds)) {}

std::string RollingFiles::write(const AccessibilityField& field, const std::vector<std::uint32_t>& point_ids) const {
  try {
    field.saveState(state);
    io::writeFileDurably(ids, [&](std::ostream& stream) {
      stream.write(reinterpret_cast<const char*>(point_ids.data()),
                   static_cast<std::streamsize>(point_ids.size() * sizeof point_ids[0]));
    });
    return io::sha256OfFile(ids);
  } catch (...) {
    remove();
    throw;
  }
}

std::vector<std::uint32_t> RollingFiles::readIds(std::size_t count, const std::string& sha256) const {
  std::vector<std::uint32_t> read(count);
  static_cast<void>(io::inputFileSize(ids));
  std::ifstream in(ids, std::ios::binary);
  if (!in.is_open()) throw InputError("input.unreadable", ids.string(), "cannot be opened", "Check its permissions");
  in.read(reinterpret_cast<char*>(read.data()), static_cast<std::streamsize>(count * sizeof read[0]));
  if (in.bad()) throw InputError("input.unreadable", ids.string(), "cannot be read to its end", "Check the disk");
  if (!in || in.peek() != std::ifstream::traits_type::eof() || io::sha256OfFile(ids) != sha256) {
    throw InputError("state.damaged", ids.string(), "is not as it was written", "Use another disk");
  }
  return read;
}

void RollingFiles::remove() const noexcept {
  std::error_code ignored;
  fs::remove(state, ignored);
  fs::remove(ids, ignored);
}

bool isRollingFile(const std::string& name, std::uint64_t& serial) {
  for (const std::string ending : {kState, kIds}) {
    if (!name.ends_with(ending)) continue;
    const std::string rest = name.substr(0, name.size() - ending.size());
    const std::size_t dot = rest.find('.');
    if (dot == std::string::npos) return false;
    try {
      static_cast<void>(TileId::parse(rest.substr(0, dot)));
    } catch (const InvalidArgument&) {
      return false;
    }
    const char* const end = rest.data() + rest.size();
    const auto [last, error] = std::from_chars(rest.data() + dot + 1, end, serial);
    return error == std::errc() && last == end;
  }
  return false;
}

}  // namespace accessvdb::tiles
