// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tiles/rolling_files.h"

#include <charconv>
#include <fstream>
#include <string_view>
#include <system_error>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/scan_io.h"
#include "accessvdb/tiles.h"
#include "field/field_access.h"
#include "field/state/state_writer.h"
#include "io/streams/input_file.h"
#include "io/streams/sha256.h"
#include "io/streams/whole_file.h"

namespace accessvdb::tiles {
namespace {

namespace fs = std::filesystem;

constexpr const char *kState = ".state", *kIds = ".ids";
constexpr std::string_view kIdsMagic = "AVDBIDS1";
/// Of the ids, and of the head of the state.
constexpr const char* kBetweenHashes = ".";

std::string headOf(const internal::StateReader& state) { return internal::hexOf(state.headDigest()); }

bool beginsWith(const fs::path& file, std::string_view magic) {
  if (io::entryAt(file) != fs::file_type::regular) return false;
  std::string first(magic.size(), '\0');
  std::ifstream in(file, std::ios::binary);
  return in.read(first.data(), static_cast<std::streamsize>(first.size())) && first == magic;
}

fs::path fileOf(const fs::path& folder, const TileIndex& tile, std::uint64_t serial, const char* ending) {
  return folder / (TileId{tile.first, tile.second, {}}.name() + "." + std::to_string(serial) + ending);
}

}  // namespace

RollingFiles::RollingFiles(const fs::path& folder, const TileIndex& tile, std::uint64_t serial)
    : state(fileOf(folder, tile, serial, kState)), ids(fileOf(folder, tile, serial, kIds)) {}

std::string RollingFiles::write(const AccessibilityField& field, const std::vector<std::uint32_t>& point_ids) const {
  try {
    internal::FieldAccess::saveState(field, state, io::writeFileWhole);
    io::writeFileWhole(ids, [&](std::ostream& stream) {
      stream.write(kIdsMagic.data(), kIdsMagic.size());
      stream.write(reinterpret_cast<const char*>(point_ids.data()),
                   static_cast<std::streamsize>(point_ids.size() * sizeof point_ids[0]));
    });
    return io::sha256OfFile(ids) + kBetweenHashes + headOf(internal::StateReader(state));
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
  in.ignore(kIdsMagic.size());
  in.read(reinterpret_cast<char*>(read.data()), static_cast<std::streamsize>(count * sizeof read[0]));
  if (in.bad()) throw InputError("input.unreadable", ids.string(), "cannot be read to its end", "Check the disk");
  const std::string written = sha256.substr(0, sha256.find(kBetweenHashes));
  if (!in || in.peek() != std::ifstream::traits_type::eof() || io::sha256OfFile(ids) != written) {
    throw InputError("state.damaged", ids.string(), "is not as it was written", "Use another disk");
  }
  return read;
}

void RollingFiles::requireWritten(const internal::StateReader& read, const std::string& sha256) const {
  if (sha256.ends_with(kBetweenHashes + headOf(read))) return;
  throw InputError("state.damaged", state.string(), "is not the one that was written", "Restore it");
}

void RollingFiles::bringToDisk() const {
  io::bringToDisk(state);
  io::bringToDisk(ids);
}

void RollingFiles::remove() const noexcept {
  std::error_code ignored;
  fs::remove(state, ignored);
  fs::remove(ids, ignored);
}

std::optional<std::uint64_t> serialOf(const std::string& file_name) {
  for (const std::string_view ending : {kState, kIds}) {
    if (!file_name.ends_with(ending)) continue;
    const std::string rest = file_name.substr(0, file_name.size() - ending.size());
    const std::size_t dot = rest.find('.');
    if (dot == std::string::npos) return std::nullopt;
    try {
      static_cast<void>(TileId::parse(rest.substr(0, dot)));
    } catch (const InvalidArgument&) {
      return std::nullopt;
    }
    std::uint64_t serial = 0;
    const char* const end = rest.data() + rest.size();
    const auto [last, error] = std::from_chars(rest.data() + dot + 1, end, serial);
    if (error == std::errc() && last == end) return serial;
  }
  return std::nullopt;
}

bool isRollingFile(const fs::path& file, std::uint64_t& serial) {
  const auto found = serialOf(file.filename().string());
  if (!found || !beginsWith(file, file.extension() == kState ? internal::kStateMagic : kIdsMagic)) return false;
  serial = *found;
  return true;
}

}  // namespace accessvdb::tiles
