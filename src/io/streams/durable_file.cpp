// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files that appear whole or not at all: temporary file, checked writes, fsync, rename, fsync of the folder.
///
/// OpenVDB 10.0.1 reports success when the disk is full, and so does a std::ofstream whose state nobody checks. Here
/// every system call is checked and the first error is kept with its cause.
#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include <array>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <ctime>
#include <map>
#include <mutex>
#include <ostream>
#include <random>
#include <streambuf>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "accessvdb/error.h"
#include "accessvdb/field_io.h"
#include "accessvdb/program/output_file.h"

namespace accessvdb::io {
namespace {

constexpr std::size_t kBufferBytes = std::size_t{4} << 20;
constexpr int kTempNameAttempts = 100;
constexpr std::size_t kTempHexDigits = 16;
// Where the file system has no locks, a temporary file that has not been written to for this long is taken for a
// killed run's.
constexpr std::time_t kStaleTempAge_s = 3600;

[[noreturn]] void throwOutputError(int error, const std::filesystem::path& path, const std::string& doing,
                                   std::uint64_t bytes_written = 0) {
  const std::string text = std::generic_category().message(error);
  switch (error) {
    case ENOSPC:
    case EDQUOT:
      throw OutputError("output.disk_full", path.string(),
                        "the disk is full (" + text + " after " + std::to_string(bytes_written) + " bytes)",
                        "Free some space or choose another folder for the output");
    case EFBIG:
      throw OutputError("output.too_large", path.string(),
                        "the file would pass the size limit of this process or file system (" + text + " after " +
                            std::to_string(bytes_written) + " bytes)",
                        "Raise the limit (ulimit -f) or choose another folder for the output");
    case EACCES:
    case EPERM:
    case EROFS:
      throw OutputError("output.permission", path.string(), "cannot " + doing + " (" + text + ")",
                        "Choose a folder for the output that you may write to");
    default:
      throw OutputError("output.write", path.string(), "cannot " + doing + " (" + text + ")",
                        "Check the folder and the disk, then run again");
  }
}

/// A write past the process's file size limit, or into a pipe that nobody reads, must become an error, not a signal.
class SignalGuard {
 public:
  SignalGuard() {
    sigemptyset(&signals_);
    sigaddset(&signals_, SIGXFSZ);
    sigaddset(&signals_, SIGPIPE);
    sigset_t pending;
    sigpending(&pending);
    was_pending_ = sigismember(&pending, SIGXFSZ) == 1 || sigismember(&pending, SIGPIPE) == 1;
    pthread_sigmask(SIG_BLOCK, &signals_, &before_);
  }
  ~SignalGuard() {
    if (!was_pending_) {
      const timespec now = {0, 0};
      while (sigtimedwait(&signals_, nullptr, &now) > 0) {
      }
    }
    pthread_sigmask(SIG_SETMASK, &before_, nullptr);
  }
  SignalGuard(const SignalGuard&) = delete;
  SignalGuard& operator=(const SignalGuard&) = delete;

 private:
  sigset_t signals_, before_;
  bool was_pending_ = false;
};

/// Output buffer over a file descriptor. Remembers the first error; seekable where `seekable` says so.
class DescriptorBuffer : public std::streambuf {
 public:
  DescriptorBuffer(int fd, bool seekable) : fd_(fd), seekable_(seekable), buffer_(kBufferBytes) {
    setp(buffer_.data(), buffer_.data() + buffer_.size());
  }
  [[nodiscard]] int error() const { return error_; }
  [[nodiscard]] std::uint64_t bytesWritten() const { return bytes_written_; }  ///< accepted by the system
  [[nodiscard]] std::uint64_t fileSize() const { return file_size_; }          ///< farthest byte written

 protected:
  int_type overflow(int_type c) override {
    if (!flushBuffer()) return traits_type::eof();
    if (!traits_type::eq_int_type(c, traits_type::eof())) {
      *pptr() = traits_type::to_char_type(c);
      pbump(1);
    }
    return traits_type::not_eof(c);
  }

  std::streamsize xsputn(const char* data, std::streamsize size) override {
    if (size <= epptr() - pptr()) {
      std::memcpy(pptr(), data, static_cast<std::size_t>(size));
      pbump(static_cast<int>(size));
      return size;
    }
    if (!flushBuffer()) return 0;
    if (size >= static_cast<std::streamsize>(buffer_.size())) {
      return writeAll(data, static_cast<std::size_t>(size)) ? size : 0;
    }
    std::memcpy(pptr(), data, static_cast<std::size_t>(size));
    pbump(static_cast<int>(size));
    return size;
  }

  int sync() override { return flushBuffer() ? 0 : -1; }

  pos_type seekoff(off_type offset, std::ios_base::seekdir from, std::ios_base::openmode which) override {
    if (!seekable_ || !(which & std::ios_base::out)) return pos_type(off_type(-1));
    const off_type here = static_cast<off_type>(position_) + (pptr() - pbase());
    if (from == std::ios_base::cur && offset == 0) return pos_type(here);
    if (!flushBuffer()) return pos_type(off_type(-1));
    off_type target = offset;
    if (from == std::ios_base::cur) target += static_cast<off_type>(position_);
    if (from == std::ios_base::end) target += static_cast<off_type>(file_size_);
    if (target < 0) return pos_type(off_type(-1));
    position_ = static_cast<std::uint64_t>(target);
    return pos_type(target);
  }
  pos_type seekpos(pos_type position, std::ios_base::openmode which) override {
    return seekoff(off_type(position), std::ios_base::beg, which);
  }

 private:
  bool flushBuffer() {
    const std::size_t size = static_cast<std::size_t>(pptr() - pbase());
    setp(buffer_.data(), buffer_.data() + buffer_.size());
    return writeAll(buffer_.data(), size);
  }

  bool writeAll(const char* data, std::size_t size) {
    if (error_ != 0) return false;
    const SignalGuard guard;
    while (size > 0) {
      const ssize_t n = seekable_ ? ::pwrite(fd_, data, size, static_cast<off_t>(position_)) : ::write(fd_, data, size);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) {
        error_ = n < 0 ? errno : ENOSPC;
        return false;
      }
      data += n;
      size -= static_cast<std::size_t>(n);
      position_ += static_cast<std::uint64_t>(n);
      bytes_written_ += static_cast<std::uint64_t>(n);
      if (position_ > file_size_) file_size_ = position_;
    }
    return true;
  }

  int fd_;
  bool seekable_;
  std::vector<char> buffer_;
  std::uint64_t position_ = 0, bytes_written_ = 0, file_size_ = 0;
  int error_ = 0;
};

std::filesystem::path folderOf(const std::filesystem::path& path) {
  return path.has_parent_path() ? path.parent_path() : std::filesystem::path(".");
}

/// "/dev/stdout" and the like, also where it leads to a file.
bool isStandardOutput(const std::filesystem::path& path) {
  struct stat target, out;
  return ::stat(path.c_str(), &target) == 0 && ::fstat(STDOUT_FILENO, &out) == 0 && target.st_dev == out.st_dev &&
         target.st_ino == out.st_ino;
}

/// The devices that take everything or nothing, and never block.
bool isSink(const struct stat& info) {
  constexpr unsigned kMemoryDevices = 1, kNull = 3, kFull = 7;  // Linux, Documentation/admin-guide/devices.txt
  return S_ISCHR(info.st_mode) && major(info.st_rdev) == kMemoryDevices &&
         (minor(info.st_rdev) == kNull || minor(info.st_rdev) == kFull);
}

std::string randomHex() {
  std::random_device device;
  const std::uint64_t bits = (static_cast<std::uint64_t>(device()) << 32) | device();
  std::array<char, kTempHexDigits + 1> text;
  std::snprintf(text.data(), text.size(), "%016llx", static_cast<unsigned long long>(bits));
  return text.data();
}

/// Marks an open temporary file as being written, until it is closed or the process ends.
/// @return false: somebody took it for a leftover and is removing it. True also where the file system has no locks.
bool markAsWritten(int fd) {
  if (::flock(fd, LOCK_EX | LOCK_NB) != 0) return errno != EWOULDBLOCK;
  struct stat info;
  return ::fstat(fd, &info) != 0 || info.st_nlink > 0;
}

bool isTempName(const std::string& name) {
  const std::string suffix = ".tmp";
  if (name.size() < kTempHexDigits + suffix.size() + 3 || name.front() != '.' || !name.ends_with(suffix)) return false;
  const std::size_t hex_begin = name.size() - suffix.size() - kTempHexDigits;
  return name[hex_begin - 1] == '.' &&
         name.substr(hex_begin, kTempHexDigits).find_first_not_of("0123456789abcdef") == std::string::npos;
}

/// Removes a temporary file unless somebody is writing it: a single file may be written without the folder's lock.
void removeUnlessWritten(const std::filesystem::path& temp) {
  const int fd = ::open(temp.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return;
  if (::flock(fd, LOCK_EX | LOCK_NB) == 0) ::unlink(temp.c_str());
  ::close(fd);
}

/// Folders that this process fills alone.
struct LockedFolders {
  std::mutex mutex;
  std::map<std::pair<dev_t, ino_t>, int> descriptors;
};
LockedFolders locked_folders;

bool isLockedByUs(const std::filesystem::path& folder) {
  struct stat info;
  if (::stat(folder.c_str(), &info) != 0) return false;
  const std::lock_guard lock(locked_folders.mutex);
  return locked_folders.descriptors.contains({info.st_dev, info.st_ino});
}

/// What killed runs left of one target, whose folder may be anybody's.
void removeStaleTempsOf(const std::filesystem::path& target) {
  const std::string begin = "." + target.filename().string() + ".";
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(folderOf(target), ignored)) {
    const std::string name = entry.path().filename().string();
    if (name.size() == begin.size() + kTempHexDigits + 4 && name.starts_with(begin) && isTempName(name)) {
      removeUnlessWritten(entry.path());
    }
  }
}

/// Names of temporary files where a signal handler can read them: it may neither lock nor allocate. More files at a
/// time than there is room for are left to removeStaleTemps().
class UnfinishedFiles {
 public:
  /// @return the place of the name, or none
  std::size_t add(const std::filesystem::path& path) {
    for (std::size_t n = 0; n < names_.size() && path.native().size() < kMostBytes; ++n) {
      Name& name = names_[n];
      if (name.taken.exchange(true)) continue;
      std::memcpy(name.text, path.c_str(), path.native().size() + 1);
      name.written = true;
      return n;
    }
    return names_.size();
  }
  void remove(std::size_t place) {
    if (place == names_.size()) return;
    names_[place].written = false;
    names_[place].taken = false;
  }
  void unlinkAll() const {
    for (const Name& name : names_) {
      if (name.written) ::unlink(name.text);
    }
  }

 private:
  static constexpr std::size_t kMostBytes = 4096;
  struct Name {
    std::atomic<bool> taken = false, written = false;
    char text[kMostBytes] = {};
  };
  static_assert(std::atomic<bool>::is_always_lock_free);
  std::array<Name, 16> names_;
};
UnfinishedFiles unfinished_files;

/// The temporary file of one target; unlinked unless it was renamed.
class TempFile {
 public:
  explicit TempFile(const std::filesystem::path& target) : target_(target) {
    // A folder that is ours was swept when it became so, and need not be listed for each file.
    if (!isLockedByUs(folderOf(target))) removeStaleTempsOf(target);
    for (int attempt = 0; attempt < kTempNameAttempts; ++attempt) {
      temp_ = folderOf(target) /
              std::string(".").append(target.filename().string()).append(".").append(randomHex()).append(".tmp");
      unfinished_ = unfinished_files.add(temp_);  // before it is there: a signal may come between
      fd_ = ::open(temp_.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0666);
      if (fd_ >= 0 && markAsWritten(fd_)) return;
      const int error = errno;
      unfinished_files.remove(unfinished_);
      errno = error;
      if (fd_ >= 0) {
        ::close(std::exchange(fd_, -1));
      } else if (errno != EEXIST && errno != EINTR) {
        break;
      }
    }
    throwOutputError(errno, target, "create a file in its folder");
  }
  ~TempFile() {
    if (fd_ >= 0) ::close(fd_);
    if (!renamed_) ::unlink(temp_.c_str());
    unfinished_files.remove(unfinished_);
  }
  TempFile(const TempFile&) = delete;
  TempFile& operator=(const TempFile&) = delete;

  [[nodiscard]] int fd() const { return fd_; }

  enum class To { Disk, System };
  void commit(std::uint64_t expected_bytes, To to) {
    if (to == To::System) {
      static_cast<void>(::sync_file_range(fd_, 0, 0, SYNC_FILE_RANGE_WRITE));  // a head start; not all systems have it
    } else if (::fsync(fd_) != 0) {
      throwOutputError(errno, target_, "bring the file to the disk", expected_bytes);
    }
    struct stat info;
    if (::fstat(fd_, &info) != 0) throwOutputError(errno, target_, "look at the file", expected_bytes);
    if (static_cast<std::uint64_t>(info.st_size) != expected_bytes) {
      throw OutputError(
          "output.verify", target_.string(),
          "holds " + std::to_string(info.st_size) + " bytes where " + std::to_string(expected_bytes) + " were written",
          "Check the disk, then run again");
    }
    const int closed = ::close(fd_);
    fd_ = -1;
    if (closed != 0 && errno != EINTR) throwOutputError(errno, target_, "close the file", expected_bytes);
    if (::rename(temp_.c_str(), target_.c_str()) != 0) throwOutputError(errno, target_, "put the file in place");
    renamed_ = true;
    if (to == To::Disk) syncFolder();
  }

 private:
  void syncFolder() const {
    const int folder = ::open(folderOf(target_).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (folder < 0) throwOutputError(errno, target_, "open its folder");
    const int result = ::fsync(folder);
    const int error = errno;
    ::close(folder);
    // Some network file systems have no fsync for folders.
    if (result != 0 && error != EINVAL && error != ENOTSUP) throwOutputError(error, target_, "sync its folder");
  }

  std::filesystem::path target_, temp_;
  std::size_t unfinished_ = 0;
  int fd_ = -1;
  bool renamed_ = false;
};

/// Runs the body on a checked stream; returns the size of the file.
std::uint64_t writeBody(int fd, bool seekable, const std::filesystem::path& path,
                        const std::function<void(std::ostream&)>& body) {
  DescriptorBuffer buffer(fd, seekable);
  std::ostream stream(&buffer);
  // The body stops at the first failed write and does not go on compressing gigabytes for nothing.
  stream.exceptions(std::ios_base::badbit | std::ios_base::failbit);
  try {
    body(stream);
    stream.flush();
  } catch (...) {
    if (buffer.error() != 0) throwOutputError(buffer.error(), path, "write", buffer.bytesWritten());
    throw;
  }
  if (buffer.error() != 0) throwOutputError(buffer.error(), path, "write", buffer.bytesWritten());
  if (!stream) throw OutputError("output.write", path.string(), "cannot write (the stream failed)", "Run again");
  return buffer.fileSize();
}

/// A stream cannot be replaced by a rename: it is written in place, without the guarantee.
void writeInPlace(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body) {
  // Without O_TRUNC: standard output may be a file that others have written to before.
  const int fd =
      isStandardOutput(path) ? ::dup(STDOUT_FILENO) : ::open(path.c_str(), O_WRONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) throwOutputError(errno, path, "open it for writing");
  try {
    writeBody(fd, false, path, body);
  } catch (...) {
    ::close(fd);
    throw;
  }
  if (::close(fd) != 0 && errno != EINTR) throwOutputError(errno, path, "close it");
}

/// Removes what killed runs left in a folder. @param locked  whether the file system has locks
void removeStaleTemps(const std::filesystem::path& folder, bool locked) {
  std::error_code ignored;
  for (const auto& entry : std::filesystem::directory_iterator(folder, ignored)) {
    if (!isTempName(entry.path().filename().string())) continue;
    struct stat info;
    if (::lstat(entry.path().c_str(), &info) != 0 || !S_ISREG(info.st_mode)) continue;
    if (locked) {
      removeUnlessWritten(entry.path());
    } else if (std::time(nullptr) - info.st_mtime > kStaleTempAge_s) {
      ::unlink(entry.path().c_str());
    }
  }
}

/// Two processes must not fill one folder. The lock is the folder's own and ends with the process.
/// @return false: the file system has no locks; the renames still keep every single file whole
bool lockFolder(const std::filesystem::path& folder) {
  const std::lock_guard lock(locked_folders.mutex);
  auto& locked = locked_folders.descriptors;
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) throwOutputError(errno, folder, "open the folder");
  struct stat info;
  if (::fstat(fd, &info) != 0) {
    ::close(fd);
    return false;
  }
  if (locked.contains({info.st_dev, info.st_ino})) {
    ::close(fd);
    return true;
  }
  if (::flock(fd, LOCK_EX | LOCK_NB) == 0) {
    locked[{info.st_dev, info.st_ino}] = fd;
    return true;
  }
  const int error = errno;
  ::close(fd);
  if (error == EWOULDBLOCK) {
    throw OutputError("output.locked", folder.string(), "another process is writing into this folder",
                      "Wait for it, or choose another folder for the output");
  }
  return false;
}

void writeFile(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body, TempFile::To to) {
  if (!path.has_filename()) {
    throw OutputError("output.name", path.string(), "is not the name of a file", "Give the name of a file");
  }
  requireOutputFile(path);
  if (isStream(path)) return writeInPlace(path, body);
  TempFile temp(path);
  temp.commit(writeBody(temp.fd(), true, path, body), to);
}

}  // namespace

void writeFileDurably(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body) {
  writeFile(path, body, TempFile::To::Disk);
}

void writeFileWhole(const std::filesystem::path& path, const std::function<void(std::ostream&)>& body) {
  writeFile(path, body, TempFile::To::System);
}

void bringToDisk(const std::filesystem::path& file) {
  const int fd = ::open(file.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) throwOutputError(errno, file, "open the file");
  const int result = ::fsync(fd), error = errno;
  ::close(fd);
  if (result != 0) throwOutputError(error, file, "bring the file to the disk");
}

bool isStream(const std::filesystem::path& path) {
  struct stat info;
  return ::stat(path.c_str(), &info) == 0 && (isSink(info) || isStandardOutput(path));
}

void requireOutputFile(const std::filesystem::path& path) {
  struct stat info;
  if (::stat(path.c_str(), &info) != 0 || isStream(path)) return;
  if (S_ISDIR(info.st_mode)) {
    throw OutputError("output.is_folder", path.string(), "is a folder", "Give the name of a file");
  }
  // A name such as /dev/stderr may lead to a regular file, but is itself no place for one.
  std::error_code error;
  const std::string folder = std::filesystem::canonical(folderOf(path), error).string();
  if (S_ISREG(info.st_mode) && folder != "/dev" && !folder.starts_with("/proc/")) return;
  throw OutputError("output.not_a_file", path.string(), "is a pipe, a socket or a device",
                    "Give the name of a regular file, or write to standard output");
}

void removeUnfinishedFiles() noexcept { unfinished_files.unlinkAll(); }

void prepareOutputFolder(const std::filesystem::path& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  // create_directories also reports success for "name/" of a folder that exists; what counts is what is there now.
  if (error) throwOutputError(error.value(), folder, "make the folder");
  if (!std::filesystem::is_directory(folder, error)) throwOutputError(ENOTDIR, folder, "use it as a folder");
  removeStaleTemps(folder, lockFolder(folder));
  const TempFile probe(folder / "probe");
  if (::write(probe.fd(), "", 1) != 1) throwOutputError(errno, folder, "write into the folder");
}

}  // namespace accessvdb::io
