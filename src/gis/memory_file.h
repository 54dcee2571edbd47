// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Files that GDAL writes into memory, so that they reach the disk as all of our outputs do: whole, or not at all.
#pragma once

#include <ostream>
#include <string>

#include "gis/gdal_library.h"

namespace accessvdb::gis {

class MemoryFile {
 public:
  /// @param ending  of its name, which drivers look at
  explicit MemoryFile(const std::string& ending) : name_("/vsimem/accessvdb" + ending) {
    gdal().VSIUnlink(name_.c_str());
  }
  ~MemoryFile() { gdal().VSIUnlink(name_.c_str()); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  [[nodiscard]] const char* name() const { return name_.c_str(); }
  /// After the data set has been closed.
  void copyTo(std::ostream& out) const {
    vsi_l_offset bytes = 0;
    const GByte* const content = gdal().VSIGetMemFileBuffer(name(), &bytes, FALSE);
    if (content == nullptr || bytes == 0) failOf("write the file");
    out.write(reinterpret_cast<const char*>(content), static_cast<std::streamsize>(bytes));
  }

 private:
  std::string name_;
};

/// A data set of GDAL that closes itself.
class DataSet {
 public:
  explicit DataSet(GDALDatasetH handle) : handle_(handle) {}
  ~DataSet() { close(); }
  DataSet(const DataSet&) = delete;
  DataSet& operator=(const DataSet&) = delete;
  [[nodiscard]] GDALDatasetH get() const { return handle_; }
  /// Writes what is left. @return whether that went well
  bool close() {
    if (handle_ == nullptr) return true;
    gdal().CPLErrorReset();
    gdal().GDALClose(handle_);
    handle_ = nullptr;
    return gdal().CPLGetLastErrorType() < CE_Failure;
  }

 private:
  GDALDatasetH handle_;
};

}  // namespace accessvdb::gis
