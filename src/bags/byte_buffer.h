// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Bytes that are about to be overwritten: not cleared first, so that memory is touched only where it is filled.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <memory>
#include <string_view>

namespace accessvdb::bags {

class ByteBuffer {
 public:
  /// Room for that many bytes. The content is lost.
  char* reset(std::size_t bytes) {
    if (bytes > capacity_) {
      data_.reset();  // first, so that old and new are never there together
      capacity_ = 0;
      data_ = std::make_unique_for_overwrite<char[]>(bytes);
      capacity_ = bytes;
    }
    size_ = bytes;
    return data_.get();
  }
  /// More room, with the content kept.
  char* grow(std::size_t bytes) {
    if (bytes > capacity_) {
      auto larger = std::make_unique_for_overwrite<char[]>(bytes);
      if (size_ > 0) std::memcpy(larger.get(), data_.get(), size_);
      data_ = std::move(larger);
      capacity_ = bytes;
    }
    size_ = bytes;
    return data_.get();
  }
  void shrink(std::size_t bytes) { size_ = std::min(size_, bytes); }
  void release() { *this = ByteBuffer(); }

  [[nodiscard]] char* data() { return data_.get(); }
  [[nodiscard]] std::string_view view() const { return {data_.get(), size_}; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] std::size_t capacity() const { return capacity_; }

 private:
  std::unique_ptr<char[]> data_;
  std::size_t size_ = 0, capacity_ = 0;
};

}  // namespace accessvdb::bags
