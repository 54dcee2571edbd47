// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/scans/scan_checks.h"

#include <algorithm>
#include <exception>
#include <map>
#include <utility>

#include "accessvdb/error.h"
#include "io/clouds/las_header.h"
#include "io/clouds/pcd_header.h"
#include "io/clouds/ply_header.h"
#include "io/scans/skipped_scans.h"
#include "io/streams/byte_source.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

/// Smaller files are headers: those of empty scans are all alike.
constexpr std::uint64_t kLeastTwin_bytes = 1024;
constexpr std::size_t kBlock = std::size_t{1} << 16;

/// What a file's header says of its data.
struct Announced {
  std::uint64_t points = 0, begin = 0;  ///< bytes of the file before the data
  std::uint64_t record_bytes = 0;       ///< 0 for text
};

Announced announcedBy(const PcdHeader& header) {
  constexpr std::uint64_t kCompressedSizes_bytes = 8;
  return {header.points, header.data_offset,
          header.data == PcdHeader::Data::Ascii    ? 0
          : header.data == PcdHeader::Data::Binary ? header.record_bytes
                                                   : kCompressedSizes_bytes + 1};
}

Announced announcedBy(const PlyHeader& header) {
  const PlyElement& vertex = header.elements[header.vertex];
  if (header.vertex != 0) return {};
  const bool text = header.format == PlyHeader::Format::Ascii || vertex.hasLists();
  return {vertex.count, header.data_offset, text ? 0 : vertex.recordBytes()};
}

/// A header without data is as little of a scan as an empty file. A cut within the data is not judged here: what is
/// left of them may be used, if that is asked for.
void requireData(const std::filesystem::path& path, std::uint64_t size, const Announced& announced) {
  const std::uint64_t bytes = size - std::min(size, announced.begin);
  constexpr std::uint64_t kLineEnds_bytes = 2;
  const bool none = announced.record_bytes > 0 ? bytes < announced.record_bytes : bytes <= kLineEnds_bytes;
  if (announced.points > 0 && none)
    throw InputError("input.truncated", forMessage(path.native()),
                     "has a header that announces " + std::to_string(announced.points) + " points, and no data",
                     "Copy the file again");
}

/// Reads the header, where that is cheap: a decoder of LAZ is not started.
void checkHeader(const std::filesystem::path& path, std::uint64_t size, ScanKind kind) {
  const std::string subject = forMessage(path.native());
  if (kind == ScanKind::Pcd)
    requireData(path, size, announcedBy(parsePcdHeader(readInputFile(path, kMaxPcdHeaderBytes), subject)));
  if (kind == ScanKind::Ply) requireData(path, size, announcedBy(parsePlyHeader(*openFile(path), subject)));
  if (kind == ScanKind::Las) {
    (void)openLas(path, {.allow_truncated = true});
    const LasFileHeader header = parseLasHeader(readInputFile(path, kLasHeaderBytes14), size, subject);
    requireData(path, size, {header.points, header.data_offset, header.record_bytes});
  }
  if (kind != ScanKind::Pcd && kind != ScanKind::Ply && kind != ScanKind::Las)
    (void)readInputFile(path, kLfsPointer.size());
}

bool haveSameBytes(const std::filesystem::path& a, const std::filesystem::path& b, std::uint64_t size) {
  const InputDescriptor one(a), other(b);
  std::string left(kBlock, '\0'), right(kBlock, '\0');
  // The middle first: scans of one sensor begin alike.
  for (std::uint64_t done = 0, at = size / 2; done < size; done += kBlock) {
    const std::size_t count = static_cast<std::size_t>(std::min<std::uint64_t>(kBlock, size - at));
    if (one.readAt(at, left.data(), count) != count || other.readAt(at, right.data(), count) != count) return false;
    if (!std::equal(left.begin(), left.begin() + static_cast<std::ptrdiff_t>(count), right.begin())) return false;
    at += count;
    if (at >= size) at = 0;
  }
  return true;
}

/// Bytes from the middle of a file.
std::string sampleOf(const std::filesystem::path& path, std::uint64_t size) {
  constexpr std::size_t kSample = 64;
  std::string sample(kSample, '\0');
  const InputDescriptor file(path);
  sample.resize(file.readAt(size / 2, sample.data(), kSample));
  return sample;
}

/// Copies have longer names, or later ones: "000003 (1).pcd".
bool isCopyOf(const std::filesystem::path& copy, const std::filesystem::path& original) {
  const std::size_t a = copy.filename().native().size(), b = original.filename().native().size();
  return a != b ? a > b : copy.filename() > original.filename();
}

void findTwins(const std::vector<std::filesystem::path>& files, const std::vector<std::uint64_t>& sizes,
               std::vector<ScanCheck>& checks) {
  std::map<std::uint64_t, std::vector<std::size_t>> of_size;
  for (std::size_t i = 0; i < files.size(); ++i)
    if (checks[i].flaw.empty() && sizes[i] >= kLeastTwin_bytes) of_size[sizes[i]].push_back(i);
  for (auto& [size, same_size] : of_size) {
    if (same_size.size() < 2) continue;
    std::map<std::string, std::vector<std::size_t>> of_sample;
    for (const std::size_t i : same_size) of_sample[sampleOf(files[i], size)].push_back(i);
    for (auto& [sample, alike] : of_sample) {
      std::sort(alike.begin(), alike.end(), [&](std::size_t a, std::size_t b) { return isCopyOf(files[b], files[a]); });
      std::vector<std::size_t> different;
      for (const std::size_t i : alike) {
        const auto twin = std::find_if(different.begin(), different.end(), [&, bytes = size](std::size_t other) {
          return haveSameBytes(files[i], files[other], bytes);
        });
        if (twin == different.end()) {
          different.push_back(i);
        } else {
          checks[i].twin = *twin;
        }
      }
    }
  }
}

std::string shownName(const std::filesystem::path& file) { return forMessage(file.filename().native(), 64); }

}  // namespace

std::vector<ScanCheck> checkScanFiles(const std::vector<std::filesystem::path>& files, ScanKind kind) {
  std::vector<ScanCheck> checks(files.size());
  std::vector<std::uint64_t> sizes;
  std::size_t flaws = 0;
  std::exception_ptr first;
  for (std::size_t i = 0; i < files.size(); ++i) {
    sizes.push_back(inputFileSize(files[i]));
    try {
      if (sizes[i] == 0)
        throw InputError("input.empty", forMessage(files[i].native()), "is empty (0 bytes)", "Copy the file again");
      checkHeader(files[i], sizes[i], kind);
    } catch (const InputError& error) {
      // Others say nothing of the content: permissions, an unknown version.
      const bool of_content = error.id() == "input.empty" || error.id() == "input.malformed" ||
                              error.id() == "input.truncated" || error.id() == "input.lfs_pointer";
      if (!of_content) throw;
      checks[i].flaw = error.problem();
      if (flaws++ == 0) first = std::current_exception();
    }
  }
  if (2 * flaws > files.size()) std::rethrow_exception(first);
  findTwins(files, sizes, checks);
  return checks;
}

void warnOfScanFiles(const std::vector<ScanCheck>& checks, const std::vector<std::filesystem::path>& files,
                     std::vector<ScanWarning>& warnings) {
  FirstFew flaws, twins;
  for (std::size_t i = 0; i < checks.size(); ++i) {
    if (!checks[i].flaw.empty()) flaws.add(shownName(files[i]) + " " + checks[i].flaw);
    if (checks[i].twin) twins.add(shownName(files[i]) + " is " + shownName(files[*checks[i].twin]));
  }
  const std::string all = " of " + std::to_string(files.size()) + " scans ";
  if (flaws.count() > 0)
    warnings.push_back({"scans.skipped", std::to_string(flaws.count()) + all + "are skipped: " + flaws.inWords()});
  if (twins.count() > 0)
    warnings.push_back(
        {"scans.repeated", std::to_string(twins.count()) + all +
                               "have the same bytes as another one, and count once: " + twins.inWords()});
}

}  // namespace accessvdb::io
