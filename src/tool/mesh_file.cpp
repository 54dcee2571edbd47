// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "tool/mesh_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <system_error>
#include <utility>
#include <vector>

#include "accessvdb/error.h"

namespace accessvdb::internal {
namespace {

std::string lowered(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = c >= 'A' && c <= 'Z' ? char(c - 'A' + 'a') : c;
  return out;
}

[[noreturn]] void malformed(const std::string& subject, const std::string& problem) {
  throw InputError("tool.malformed", subject, problem, "Export or copy the mesh again");
}

std::uint64_t countOf(std::string_view text, std::string_view word) {
  std::uint64_t count = 0;
  for (std::size_t at = text.find(word); at != text.npos; at = text.find(word, at + word.size())) ++count;
  return count;
}

/// Words of one line.
std::vector<std::string_view> wordsOf(std::string_view line) {
  std::vector<std::string_view> words;
  for (std::size_t at = 0; at < line.size();) {
    const std::size_t begin = line.find_first_not_of(" \t\r", at);
    if (begin == line.npos) break;
    const std::size_t end = std::min(line.find_first_of(" \t\r", begin), line.size());
    words.push_back(line.substr(begin, end - begin));
    at = end;
  }
  return words;
}

std::optional<std::uint64_t> wholeNumber(std::string_view word) {
  std::uint64_t value = 0;
  const auto result = std::from_chars(word.data(), word.data() + word.size(), value);
  if (result.ec != std::errc() || result.ptr != word.data() + word.size()) return std::nullopt;
  return value;
}

/// Whether what follows the announced faces may be another one: three different corners with ordinary coordinates.
/// Text and zeros, which programs leave there, are not.
bool looksLikeFace(std::string_view bytes) {
  std::array<float, 12> values;
  if (bytes.size() < 50) return false;
  std::memcpy(values.data(), bytes.data(), sizeof values);
  const auto ordinary = [](float v) { return v == 0 || (std::abs(v) > 1e-9F && std::abs(v) < 1e7F); };
  if (!std::all_of(values.begin(), values.end(), ordinary)) return false;
  return !std::equal(&values[3], &values[6], &values[6]) && !std::equal(&values[6], &values[9], &values[9]) &&
         !std::equal(&values[3], &values[6], &values[9]);
}

void checkStl(MeshFile& file, const std::string& subject) {
  const std::string& b = file.bytes;
  std::uint32_t faces = 0;
  if (b.size() >= 84) std::memcpy(&faces, b.data() + 80, 4);
  const std::uint64_t binary_size = 84 + std::uint64_t{50} * faces;
  const std::string start = lowered(std::string_view(b).substr(0, 1024));
  // Binary files may begin with "solid" and name facets too; the count decides: read as one, four letters announce more
  // faces than any file has.
  const bool counted = b.size() >= 84 && binary_size <= kMaxMeshFileBytes;
  const bool text = !counted && start.find("solid") != start.npos &&
                    (start.find("facet") != start.npos || start.find('\0') == start.npos);
  if (text) {
    const std::string all = lowered(b);
    file.expected_faces = countOf(all, "endfacet");
    const std::uint64_t begun = countOf(all, "facet normal");
    if (begun > *file.expected_faces) {
      malformed(subject, "the STL is truncated: " + std::to_string(begun) + " faces begin and " +
                             std::to_string(*file.expected_faces) + " end");
    }
    if (b.find("solid") == b.npos) file.bytes = all;  // assimp knows the words in small letters only
    return;
  }
  if (b.size() < 84) malformed(subject, "the file is too short for a binary STL and is not a text STL");
  if (b.size() < binary_size) {
    malformed(subject, "the STL announces " + std::to_string(faces) + " faces but has room for " +
                           std::to_string((b.size() - 84) / 50));
  }
  file.expected_faces = faces;
  const std::uint64_t behind = b.size() - binary_size;
  if (behind == 0) return;
  if (looksLikeFace(std::string_view(b).substr(binary_size)))
    malformed(subject, "the STL announces " + std::to_string(faces) + " faces and seems to have " +
                           std::to_string((b.size() - 84) / 50));
  file.notes.push_back(std::to_string(behind) + " bytes behind the last face of the STL are ignored");
  file.bytes.resize(binary_size);  // assimp takes no others
}

std::uint64_t plyScalarBytes(std::string_view type) {
  static constexpr std::pair<std::string_view, std::uint64_t> kTypes[] = {
      {"char", 1},  {"uchar", 1},   {"int8", 1},   {"uint8", 1},  {"short", 2}, {"ushort", 2},
      {"int16", 2}, {"uint16", 2},  {"int", 4},    {"uint", 4},   {"int32", 4}, {"uint32", 4},
      {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
  for (const auto& [name, bytes] : kTypes) {
    if (name == type) return bytes;
  }
  return 0;
}

/// Assimp trusts the counts in a PLY header, so they are compared with the file's size first.
void checkPly(MeshFile& file, const std::string& subject) {
  const std::string_view all = file.bytes;
  if (all.substr(0, 3) != "ply") malformed(subject, "the file does not begin like a PLY");
  bool ascii = false, ended = false;
  std::uint64_t element_count = 0, record_bytes = 0, least = 0;
  // Bytes of binary records, or lines of text. Rejects anything larger than a file can be.
  const auto closeElement = [&] {
    const std::uint64_t each = ascii ? 1 : record_bytes;
    least =
        each > 0 && element_count > 2 * kMaxMeshFileBytes / each ? 2 * kMaxMeshFileBytes : least + element_count * each;
    least = std::min(least, 2 * kMaxMeshFileBytes);
    element_count = record_bytes = 0;
  };
  std::size_t at = 0;
  for (int line_number = 0; at < all.size() && line_number < 1000 && !ended; ++line_number) {
    const std::size_t end = std::min(all.find('\n', at), all.size());
    const std::vector<std::string_view> words = wordsOf(all.substr(at, std::min<std::size_t>(end - at, 4096)));
    at = end + 1;
    if (words.empty() || words[0] == "comment" || words[0] == "obj_info") continue;
    if (words[0] == "format") {
      ascii = words.size() > 1 && words[1] == "ascii";
    } else if (words[0] == "element") {
      const auto count = words.size() == 3 ? wholeNumber(words[2]) : std::nullopt;
      if (!count) malformed(subject, "line " + std::to_string(line_number + 1) + " of the PLY header cannot be parsed");
      closeElement();
      if (words[1] == "tristrips") {
        throw InputError("tool.format", subject, "the PLY contains triangle strips, which are not supported",
                         "Export it with plain faces");
      }
      element_count = *count;
      if (words[1] == "face") file.expected_faces = *count;
    } else if (words[0] == "property") {
      const bool list = words.size() == 5 && words[1] == "list";
      const std::uint64_t bytes = words.size() > 2 ? plyScalarBytes(words[list ? 2 : 1]) : 0;
      if (bytes == 0 || (!list && words.size() != 3)) {
        malformed(subject, "line " + std::to_string(line_number + 1) + " of the PLY header cannot be parsed");
      }
      record_bytes += bytes;
    } else if (words[0] == "end_header") {
      ended = true;
    }
  }
  closeElement();
  if (!ended) malformed(subject, "the PLY header does not end");
  const std::string_view body = at < all.size() ? all.substr(at) : std::string_view();
  if (!ascii && least > body.size()) {
    malformed(subject, "the PLY header announces at least " + std::to_string(least) + " bytes but " +
                           std::to_string(body.size()) + " follow");
  }
  if (ascii) {
    // One record per line. Assimp reads the last line repeatedly if lines are missing.
    std::uint64_t records = 0;
    for (std::size_t begin = 0; begin < body.size();) {
      const std::size_t end = std::min(body.find('\n', begin), body.size());
      if (body.substr(begin, end - begin).find_first_not_of(" \t\r") < end - begin) ++records;
      begin = end + 1;
    }
    if (least > records) {
      malformed(subject, "the PLY header announces " + std::to_string(least) + " records but " +
                             std::to_string(records) + " lines follow");
    }
  }
}

/// The file's own unit; by COLLADA's rules, metre if there is none.
double colladaUnit(std::string_view all, const std::string& subject) {
  std::size_t unit = all.find("<unit");
  for (; unit != all.npos; unit = all.find("<unit", unit + 1)) {
    const std::size_t comment = all.rfind("<!--", unit);
    if (comment == all.npos || all.find("-->", comment) < unit) break;
  }
  if (unit == all.npos) return 1.0;
  const std::string_view tag = all.substr(unit, std::min<std::size_t>(all.find('>', unit), all.size()) - unit);
  // The unit's name may contain the word too: name="millimeter".
  std::size_t meter = tag.find("meter");
  while (meter != tag.npos && std::string_view(" \t\r\n").find(tag[meter - 1]) == tag.npos) {
    meter = tag.find("meter", meter + 1);
  }
  if (meter == tag.npos) return 1.0;
  const std::size_t open = tag.find_first_of("\"'", meter);
  const std::size_t close = open == tag.npos ? open : tag.find_first_of("\"'", open + 1);
  double value = 0;
  if (close == tag.npos) malformed(subject, "the COLLADA unit cannot be parsed");
  const std::string_view digits = tag.substr(open + 1, close - open - 1);
  const auto result = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (result.ec != std::errc() || !(value > 0 && std::isfinite(value))) {
    malformed(subject, "the COLLADA unit is not a positive length");
  }
  return value;
}

MeshFormat formatOf(const std::string& extension, const std::string& subject) {
  static constexpr std::pair<std::string_view, MeshFormat> kFormats[] = {
      {"stl", MeshFormat::Stl},     {"obj", MeshFormat::Obj},   {"ply", MeshFormat::Ply}, {"off", MeshFormat::Off},
      {"dae", MeshFormat::Collada}, {"gltf", MeshFormat::Gltf}, {"glb", MeshFormat::Glb}};
  for (const auto& [name, format] : kFormats) {
    if (name == extension) return format;
  }
  throw InputError(
      "tool.format", subject,
      extension.empty() ? "the mesh has no file extension" : "meshes ending in ." + extension + " are not supported",
      "Use STL, OBJ, PLY, OFF, DAE, glTF or GLB, or builtin:pencil or builtin:pruner");
}

}  // namespace

std::optional<std::string> readRegularFile(const std::filesystem::path& path, std::uint64_t max_bytes,
                                           std::string& problem) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) {
    problem = "cannot be opened: " + std::generic_category().message(errno);
    return std::nullopt;
  }
  struct Closer {
    int fd;
    ~Closer() { ::close(fd); }
  } closer{fd};
  struct stat info = {};
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
    problem = S_ISDIR(info.st_mode) ? "is a folder, not a mesh file" : "is not a regular file";
    return std::nullopt;
  }
  if (std::uint64_t(info.st_size) > max_bytes) {
    problem = "has " + std::to_string(info.st_size) + " bytes; at most " + std::to_string(max_bytes) + " are supported";
    return std::nullopt;
  }
  std::string bytes(std::size_t(info.st_size), '\0');
  std::size_t got = 0;
  while (got < bytes.size()) {
    const ssize_t n = ::read(fd, bytes.data() + got, bytes.size() - got);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) {
      problem = "cannot be read: " + std::generic_category().message(errno);
      return std::nullopt;
    }
    if (n == 0) break;
    got += std::size_t(n);
  }
  bytes.resize(got);
  return bytes;
}

MeshFile openMeshFile(const std::filesystem::path& path) {
  const std::string subject = path.string();
  MeshFile file;
  file.extension = lowered(path.extension().string());
  if (!file.extension.empty()) file.extension.erase(0, 1);

  std::string problem;
  std::optional<std::string> bytes = readRegularFile(path, kMaxMeshFileBytes, problem);
  if (!bytes)
    throw InputError("input.unreadable", subject, "the tool mesh " + problem,
                     "Check the path of ToolGeometry::fromMesh");
  file.format = formatOf(file.extension, subject);
  file.bytes = std::move(*bytes);
  const std::string_view all = file.bytes;
  if (all.empty()) throw InputError("input.empty", subject, "the file is empty", "Export or copy the mesh again");
  if (all.starts_with("version https://git-lfs.github.com/spec")) {
    throw InputError("input.lfs_pointer", subject, "this is a git LFS pointer, not the mesh itself",
                     "Run git lfs pull in its repository");
  }
  const bool text = file.format == MeshFormat::Obj || file.format == MeshFormat::Off ||
                    file.format == MeshFormat::Collada || file.format == MeshFormat::Gltf;
  if (text && (all.starts_with("\xff\xfe") || all.starts_with("\xfe\xff"))) {
    throw InputError("tool.encoding", subject, "the file is UTF-16 text, which is not supported", "Save it as UTF-8");
  }
  if (file.format == MeshFormat::Stl) checkStl(file, subject);
  if (file.format == MeshFormat::Ply) checkPly(file, subject);
  if (file.format == MeshFormat::Collada) file.metres_per_unit = colladaUnit(all, subject);
  if (file.format == MeshFormat::Gltf) file.metres_per_unit = 1.0;
  if (file.format == MeshFormat::Glb) {
    if (!all.starts_with("glTF")) malformed(subject, "the file does not begin like a GLB");
    file.metres_per_unit = 1.0;
  }
  return file;
}

}  // namespace accessvdb::internal
