// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/streams/input_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <limits>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"

namespace accessvdb::io {
namespace {

constexpr std::size_t kReadStep = std::size_t{1} << 24;

std::string adviceFor(int error) {
  if (error == EMFILE || error == ENFILE) return "Raise the limit on open files (ulimit -n)";
  return error == EACCES || error == EPERM ? "Check the permissions" : "Check the file system";
}

/// Whether the error says that there is nothing of this name.
bool saysNothing(int error) {
  return error == ENOENT || error == ENOTDIR || error == ENAMETOOLONG || error == ELOOP || error == EINVAL;
}

std::filesystem::file_type typeBy(int (*look)(const char*, struct stat*), const std::filesystem::path& path,
                                  ErrorCode of) {
  struct stat info {};
  if (path.empty()) return std::filesystem::file_type::not_found;
  if (look(path.c_str(), &info) == 0) {
    if (S_ISREG(info.st_mode)) return std::filesystem::file_type::regular;
    if (S_ISDIR(info.st_mode)) return std::filesystem::file_type::directory;
    return S_ISLNK(info.st_mode) ? std::filesystem::file_type::symlink : std::filesystem::file_type::unknown;
  }
  const int error = errno;
  if (saysNothing(error)) return std::filesystem::file_type::not_found;
  const std::string problem = std::string("cannot be looked at: ") + std::strerror(error);
  if (of == ErrorCode::Output)
    throw OutputError("output.unreadable", forMessage(path.native()), problem, adviceFor(error));
  throw InputError("input.unreadable", forMessage(path.native()), problem, adviceFor(error));
}

}  // namespace

std::filesystem::file_type typeAt(const std::filesystem::path& path, ErrorCode of) { return typeBy(::stat, path, of); }
std::filesystem::file_type entryAt(const std::filesystem::path& path, ErrorCode of) {
  return typeBy(::lstat, path, of);
}

std::string beginningAt(const std::filesystem::path& path, std::uint64_t bytes) {
  if (!isFile(path)) return {};
  const InputDescriptor file(path);
  std::string text(std::min(file.size(), bytes), '\0');
  text.resize(file.readAt(0, text.data(), text.size()));
  return text;
}

std::string contentAt(const std::filesystem::path& path, std::uint64_t max_bytes) {
  if (!isFile(path)) return {};
  const InputDescriptor file(path);
  const std::uint64_t size = file.size();
  if (size > max_bytes) return {};
  std::string bytes(size, '\0');
  if (file.readAt(0, bytes.data(), bytes.size()) != size) file.throwChanged();
  return bytes;
}

InputDescriptor::InputDescriptor(const std::filesystem::path& path)
    // O_NONBLOCK: opening a pipe without a writer must not block forever.
    : path_(path), fd_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK)) {
  if (fd_ < 0) {
    const int error = errno;
    const bool missing = error == ENOENT || error == ENOTDIR;
    throw InputError(missing ? "input.missing" : "input.unreadable", forMessage(path.native()),
                     std::string("cannot be opened: ") + std::strerror(error),
                     missing ? "Check the path" : adviceFor(error));
  }
}

InputDescriptor::~InputDescriptor() { ::close(fd_); }

std::uint64_t InputDescriptor::size() const {
  struct stat info {};
  if (::fstat(fd_, &info) != 0)
    throw InputError("input.unreadable", forMessage(path_.native()), std::strerror(errno), "Check the file system");
  if (!S_ISREG(info.st_mode))
    throw InputError("input.not_a_file", forMessage(path_.native()),
                     S_ISDIR(info.st_mode) ? "is a folder where a file is needed" : "is not a regular file",
                     "Use the path of a regular file");
  return static_cast<std::uint64_t>(info.st_size);
}

std::size_t InputDescriptor::readAt(std::uint64_t offset, char* to, std::size_t count) const {
  std::size_t have = 0;
  while (have < count) {
    const ssize_t n = ::pread(fd_, to + have, std::min(kReadStep, count - have), static_cast<off_t>(offset + have));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0)
      throw InputError("input.unreadable", forMessage(path_.native()),
                       "reading failed at byte " + std::to_string(offset + have) + ": " + std::strerror(errno),
                       "Check the disk");
    if (n == 0) break;
    have += static_cast<std::size_t>(n);
  }
  return have;
}

void InputDescriptor::throwChanged() const {
  throw InputError("input.changed", forMessage(path_.native()), "changed its size while being read",
                   "Wait until it is complete");
}

void refuseLfsPointer(std::string_view beginning, const std::string& subject) {
  if (beginning.substr(0, kLfsPointer.size()) == kLfsPointer)
    throw InputError("input.lfs_pointer", subject, "is a Git LFS pointer, not the data",
                     "Run 'git lfs pull' in the file's repository");
}

std::string forMessage(std::string_view text, std::size_t max_bytes) {
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (out.size() >= max_bytes) return out + "...";
    if (byte >= 0x20 && byte != 0x7f) {
      out += c;
      continue;
    }
    constexpr std::string_view kHex = "0123456789abcdef";
    out += "\\x";
    out += kHex[byte >> 4];
    out += kHex[byte & 15];
  }
  return out;
}

std::uint64_t inputFileSize(const std::filesystem::path& path) { return InputDescriptor(path).size(); }

std::string readInputFile(const std::filesystem::path& path, std::uint64_t max_bytes) {
  const InputDescriptor file(path);
  const std::uint64_t size = file.size();
  const std::string subject = forMessage(path.native());
  if (size == 0) throw InputError("input.empty", subject, "is empty (0 bytes)", "Copy the file again");
  std::string bytes(std::min(size, max_bytes), '\0');
  if (file.readAt(0, bytes.data(), bytes.size()) != bytes.size() || file.size() != size) file.throwChanged();
  refuseLfsPointer(bytes, subject);
  return bytes;
}

std::uint64_t recordsAvailable(const std::string& subject, std::uint64_t promised, std::uint64_t record_bytes,
                               std::uint64_t available_bytes, bool allow_truncated, std::uint64_t& missing) {
  const std::uint64_t complete = available_bytes / record_bytes;
  missing = promised > complete ? promised - complete : 0;
  if (missing == 0) return promised;
  if (allow_truncated) return complete;
  const bool countable = promised <= std::numeric_limits<std::uint64_t>::max() / record_bytes;
  throw InputError("input.truncated", subject,
                   "the header announces " + std::to_string(promised) + " points" +
                       (countable ? " (" + std::to_string(promised * record_bytes) + " bytes)" : std::string()) +
                       " but " + std::to_string(available_bytes) + " bytes follow: " + std::to_string(complete) +
                       " complete points",
                   "Use allow_truncated to keep " + std::to_string(complete) + " points");
}

}  // namespace accessvdb::io
