// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "bags/sqlite_file.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <cstring>
#include <exception>

namespace accessvdb::bags {
namespace {

struct OpenFile {
  sqlite3_file base;  // first, as SQLite requires
  const SqliteFile* file;
};

const ByteInput& inputOf(sqlite3_file* file) { return reinterpret_cast<OpenFile*>(file)->file->input(); }

/// What the header says, where it is to be believed and the file is shorter: SQLite would refuse the file otherwise.
std::uint64_t wholeBytesOf(const ByteInput& input) {
  constexpr std::size_t kHeader = 100;
  if (input.size() < kHeader) return input.size();
  std::array<unsigned char, kHeader> header;
  input.read(0, reinterpret_cast<char*>(header.data()), header.size());
  const auto number = [&](std::size_t at) {
    return std::uint64_t{header[at]} << 24 | std::uint64_t{header[at + 1]} << 16 | std::uint64_t{header[at + 2]} << 8 |
           header[at + 3];
  };
  const std::uint64_t page = std::uint64_t{header[16]} << 8 | header[17];
  const bool counted = number(24) == number(92);  // the count of pages was written by the last change
  return counted ? std::max(input.size(), number(28) * (page == 1 ? 65536 : page)) : input.size();
}

int readAt(sqlite3_file* file, void* to, int count, sqlite3_int64 offset) {
  const ByteInput& input = inputOf(file);
  const auto begin = static_cast<std::uint64_t>(offset), wanted = static_cast<std::uint64_t>(count);
  if (offset < 0 || count < 0 || begin > input.size() || wanted > input.size() - begin) {
    // The first bytes of a file that is no database at all are asked for without knowing its size.
    if (begin != 0) return SQLITE_IOERR_READ;
    std::memset(to, 0, static_cast<std::size_t>(count));
    return SQLITE_IOERR_SHORT_READ;
  }
  try {
    input.read(begin, static_cast<char*>(to), static_cast<std::size_t>(wanted));
  } catch (const std::exception&) {
    return SQLITE_IOERR_READ;  // no exception may pass through C
  }
  return SQLITE_OK;
}

int sizeOf(sqlite3_file* file, sqlite3_int64* size) {
  *size = static_cast<sqlite3_int64>(reinterpret_cast<OpenFile*>(file)->file->wholeBytes());
  return SQLITE_OK;
}

sqlite3_io_methods readingMethods() {
  sqlite3_io_methods methods = {};
  methods.iVersion = 1;
  methods.xClose = [](sqlite3_file*) { return SQLITE_OK; };
  methods.xRead = readAt;
  methods.xWrite = [](sqlite3_file*, const void*, int, sqlite3_int64) { return SQLITE_READONLY; };
  methods.xTruncate = [](sqlite3_file*, sqlite3_int64) { return SQLITE_READONLY; };
  methods.xSync = [](sqlite3_file*, int) { return SQLITE_OK; };
  methods.xFileSize = sizeOf;
  methods.xLock = [](sqlite3_file*, int) { return SQLITE_OK; };
  methods.xUnlock = [](sqlite3_file*, int) { return SQLITE_OK; };
  methods.xCheckReservedLock = [](sqlite3_file*, int* reserved) {
    *reserved = 0;
    return SQLITE_OK;
  };
  methods.xFileControl = [](sqlite3_file*, int, void*) { return SQLITE_NOTFOUND; };
  methods.xSectorSize = [](sqlite3_file*) { return 0; };
  methods.xDeviceCharacteristics = [](sqlite3_file*) { return SQLITE_IOCAP_IMMUTABLE; };
  return methods;
}

int openMain(sqlite3_vfs* vfs, const char*, sqlite3_file* file, int flags, int* out_flags) {
  static const sqlite3_io_methods kMethods = readingMethods();
  auto* const open = reinterpret_cast<OpenFile*>(file);
  open->base.pMethods = nullptr;
  if ((flags & SQLITE_OPEN_MAIN_DB) == 0) return SQLITE_CANTOPEN;
  open->base.pMethods = &kMethods;
  open->file = static_cast<const SqliteFile*>(vfs->pAppData);
  if (out_flags != nullptr) *out_flags = SQLITE_OPEN_READONLY;
  return SQLITE_OK;
}

std::string freshName() {
  static std::atomic<std::uint64_t> count = 0;
  return "accessvdb" + std::to_string(++count);
}

}  // namespace

SqliteFile::SqliteFile(std::unique_ptr<ByteInput> input)
    : input_(std::move(input)), whole_bytes_(wholeBytesOf(*input_)), name_(freshName()) {
  vfs_.iVersion = 1;
  vfs_.szOsFile = sizeof(OpenFile);
  vfs_.mxPathname = 64;
  vfs_.zName = name_.c_str();
  vfs_.pAppData = this;
  vfs_.xOpen = openMain;
  vfs_.xDelete = [](sqlite3_vfs*, const char*, int) { return SQLITE_READONLY; };
  vfs_.xAccess = [](sqlite3_vfs*, const char*, int, int* result) {
    *result = 0;
    return SQLITE_OK;
  };
  vfs_.xFullPathname = [](sqlite3_vfs*, const char* name, int size, char* full) {
    sqlite3_snprintf(size, full, "%s", name);
    return SQLITE_OK;
  };
  vfs_.xRandomness = [](sqlite3_vfs*, int bytes, char* to) {
    std::memset(to, 0, static_cast<std::size_t>(bytes));
    return bytes;
  };
  vfs_.xSleep = [](sqlite3_vfs*, int microseconds) { return microseconds; };
  vfs_.xCurrentTime = [](sqlite3_vfs*, double* days) {
    *days = 0;
    return SQLITE_OK;
  };
  vfs_.xGetLastError = [](sqlite3_vfs*, int, char*) { return 0; };
  ::sqlite3_vfs_register(&vfs_, 0);
}

SqliteFile::~SqliteFile() { ::sqlite3_vfs_unregister(&vfs_); }

}  // namespace accessvdb::bags
