// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/scans/scan_files.h"

#include <algorithm>
#include <map>
#include <system_error>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

namespace fs = std::filesystem;

constexpr const char* kKnownKinds =
    "Supported are .pcd, .ply, .bin (KITTI), .las, .laz, .ptx, .xyz, .pts, .asc (text) for one cloud, and the "
    "recordings .mcap, .db3 and "
    ".bag";

std::string lowerExtension(const fs::path& path) {
  std::string extension = path.extension().string();
  for (char& c : extension)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return extension;
}

std::optional<ScanKind> kindOf(const fs::path& path) {
  const std::string extension = lowerExtension(path);
  if (extension == ".pcd") return ScanKind::Pcd;
  if (extension == ".ply") return ScanKind::Ply;
  if (extension == ".bin") return ScanKind::KittiBin;
  if (extension == ".las") return ScanKind::Las;
  if (extension == ".laz") return ScanKind::Laz;
  if (extension == ".xyz" || extension == ".pts" || extension == ".asc") return ScanKind::Xyz;
  if (extension == ".ptx") return ScanKind::Ptx;
  if (extension == ".mcap") return ScanKind::Mcap;
  if (extension == ".bag") return ScanKind::RosBag;
  if (extension == ".db3") return ScanKind::Sqlite;
  return std::nullopt;
}

/// @throws InputError for a scan or recording that was packed as a whole, as ros2 bag does with --compression-mode file
void refusePacked(const fs::path& path) {
  const std::string extension = lowerExtension(path);
  constexpr std::pair<const char*, const char*> kUnpackers[] = {
      {".zstd", "zstd -d"}, {".zst", "zstd -d"}, {".gz", "gzip -dk"}, {".bz2", "bzip2 -dk"},
      {".xz", "xz -dk"},    {".lz4", "lz4 -d"},  {".zip", "unzip"},   {".7z", "7z x"}};
  for (const auto& [ending, unpacker] : kUnpackers)
    if (extension == ending)
      throw InputError("input.compressed", forMessage(path.native()),
                       std::string("is compressed as a whole (") + (ending + 1) + ")",
                       std::string("Unpack it: ") + unpacker + " " + forMessage(path.native()));
}

std::vector<fs::path> entriesOf(const fs::path& folder) {
  std::vector<fs::path> entries;
  std::error_code error;
  for (fs::directory_iterator it(folder, error), end; !error && it != end; it.increment(error))
    if (it->path().filename().native().front() != '.') entries.push_back(it->path());
  if (error)
    throw InputError("input.unreadable", forMessage(folder.native()), "cannot be listed: " + error.message(),
                     "Check the permissions");
  std::sort(entries.begin(), entries.end(), [](const fs::path& a, const fs::path& b) {
    return naturalLess(a.filename().native(), b.filename().native());
  });
  return entries;
}

/// Scans directly in the folder; if there are several kinds, those of the most frequent one.
std::optional<ScanFileList> scansIn(const fs::path& folder) {
  std::map<ScanKind, std::vector<fs::path>> by_kind;
  for (const fs::path& entry : entriesOf(folder)) {
    std::error_code error;
    const std::optional<ScanKind> kind = kindOf(entry);
    if (kind && *kind != ScanKind::Xyz && !fs::is_directory(entry, error)) by_kind[*kind].push_back(entry);
  }
  if (by_kind.empty()) return std::nullopt;
  const auto most = std::max_element(by_kind.begin(), by_kind.end(),
                                     [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  ScanFileList list;
  list.kind = most->first;
  list.files = most->second;
  list.folder = folder;
  list.whole_folder = true;
  for (const auto& [kind, files] : by_kind)
    if (kind != list.kind)
      list.notices.push_back("scans: " + std::to_string(files.size()) + " " + lowerExtension(files.front()) +
                             " files in the folder are not used; the scans are taken to be the " +
                             std::to_string(list.files.size()) + " " + lowerExtension(list.files.front()) + " files");
  return list;
}

ScanFileList scansInSubfolder(const fs::path& folder) {
  std::vector<ScanFileList> found;
  const std::vector<fs::path> entries = entriesOf(folder);
  for (const fs::path& entry : entries) {
    if (!isFolder(entry)) continue;
    auto list = scansIn(entry);
    if (!list) continue;
    if (entry.filename() == "velodyne") found.clear();
    found.push_back(std::move(*list));
    if (entry.filename() == "velodyne") break;
  }
  const std::string subject = forMessage(folder.native());
  if (found.empty())
    for (const fs::path& entry : entries)
      if (kindOf(entry.stem())) refusePacked(entry);
  if (found.empty()) throw InputError("input.no_scans", subject, "contains no scans", kKnownKinds);
  if (found.size() > 1)
    throw InputError("input.no_scans", subject,
                     "contains no scans itself, but several of its sub-folders do (" +
                         forMessage(found[0].folder.filename().native()) + ", " +
                         forMessage(found[1].folder.filename().native()) + ", ...)",
                     "Name the right sub-folder");
  found.front().notices.push_back("scans: taken from the sub-folder " +
                                  forMessage(found.front().folder.filename().native()));
  return std::move(found.front());
}

}  // namespace

bool naturalLess(std::string_view a, std::string_view b) {
  const auto isDigit = [](char c) { return c >= '0' && c <= '9'; };
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (!isDigit(a[i]) || !isDigit(b[j])) {
      if (a[i] != b[j]) return static_cast<unsigned char>(a[i]) < static_cast<unsigned char>(b[j]);
      ++i, ++j;
      continue;
    }
    const auto run = [&](std::string_view text, std::size_t& at) {
      const std::size_t begin = at;
      while (at < text.size() && isDigit(text[at])) ++at;
      std::string_view digits = text.substr(begin, at - begin);
      digits.remove_prefix(std::min(digits.find_first_not_of('0'), digits.size()));
      return digits;
    };
    const std::string_view left = run(a, i), right = run(b, j);
    if (left.size() != right.size()) return left.size() < right.size();
    if (left != right) return left < right;
  }
  if ((i < a.size()) != (j < b.size())) return i == a.size();
  return a < b;  // at most leading zeros differ: the order stays well defined
}

ScanFileList listScans(const fs::path& path) {
  if (isFolder(path)) {
    auto list = scansIn(path);
    return list ? std::move(*list) : scansInSubfolder(path);
  }
  return listScanFile(path);
}

std::vector<fs::path> scanFilesIn(const fs::path& folder, ScanKind kind) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const fs::path& entry : entriesOf(folder))
    if (kindOf(entry) == kind && !fs::is_directory(entry, error)) files.push_back(entry);
  return files;
}

ScanFileList listScanFile(const fs::path& path) {
  (void)inputFileSize(path);
  const std::optional<ScanKind> kind = kindOf(path);
  if (!kind) refusePacked(path);
  if (!kind)
    throw InputError("input.unsupported", forMessage(path.native()), "is not a scan file of a known kind", kKnownKinds);
  ScanFileList list;
  list.kind = *kind;
  list.files = {path};
  list.folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
  return list;
}

}  // namespace accessvdb::io
