// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/streams/byte_source.h"

#include <algorithm>
#include <cstring>

#include "accessvdb/error.h"
#include "io/streams/input_file.h"

namespace accessvdb::io {
namespace {

/// Large enough that a system call costs nothing per point, small enough to stay in the cache.
constexpr std::size_t kWindowBytes = std::size_t{1} << 18;

class FileSource final : public ByteSource {
 public:
  explicit FileSource(const std::filesystem::path& path) : file_(path), size_(file_.size()) {
    if (size_ == 0)
      throw InputError("input.empty", forMessage(path.native()), "is empty (0 bytes)", "Copy the file again");
    refuseLfsPointer(view(0, kLfsPointer.size()), forMessage(path.native()));
  }
  [[nodiscard]] std::optional<std::uint64_t> size() const override { return size_; }
  void checkAtEnd() override {
    if (file_.size() != size_) file_.throwChanged();
  }

 private:
  std::size_t fill(std::uint64_t offset, char* to, std::size_t wanted) override {
    if (offset >= size_) return 0;
    const auto count = static_cast<std::size_t>(std::min<std::uint64_t>(wanted, size_ - offset));
    if (file_.readAt(offset, to, count) != count) file_.throwChanged();
    return count;
  }

  InputDescriptor file_;
  std::uint64_t size_;
};

}  // namespace

void ByteSource::slide(std::uint64_t offset, std::size_t count) {
  const std::uint64_t skip = offset - begin_;
  std::size_t kept = 0;
  if (offset >= begin_ && skip < have_) {
    kept = have_ - static_cast<std::size_t>(skip);
    std::memmove(window_.data(), window_.data() + skip, kept);
  }
  begin_ = offset;
  have_ = kept;
  std::uint64_t wanted = std::max(count, kWindowBytes);
  // A count from a file must not become an allocation that the file cannot fill.
  if (const auto known = size()) wanted = std::min(wanted, *known - std::min(*known, offset));
  wanted = std::max<std::uint64_t>(wanted, kept);
  if (window_.size() < wanted) window_.resize(wanted);
  have_ += fill(offset + kept, window_.data() + kept, static_cast<std::size_t>(wanted) - kept);
  ends_ = have_ < wanted || (size() && offset + have_ >= *size());
}

std::unique_ptr<ByteSource> openFile(const std::filesystem::path& path) { return std::make_unique<FileSource>(path); }

}  // namespace accessvdb::io
