// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "accessvdb/output_check.h"

#include <tbb/task_group.h>

#include <algorithm>
#include <atomic>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "accessvdb/error.h"
#include "accessvdb/program/path_facts.h"
#include "accessvdb/scan_io.h"
#include "io/streams/input_file.h"
#include "io/streams/sha256.h"

namespace accessvdb::io {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr std::size_t kHashBlockBytes = std::size_t{1} << 20, kHashBlocksPerTask = 16;
constexpr std::uintmax_t kLargestRecord = std::uintmax_t{256} << 20;
constexpr const char* kChangedAdvice =
    "Copy the folder again or run again what wrote it; allow_changed reads a file that you changed on purpose";

/// A file's hash in the making, by tasks that run beside the caller.
class HashInTasks {
 public:
  /// @param by_blocks  as sha256OfBlocks(); else of the whole, in one task
  HashInTasks(fs::path file, std::uint64_t bytes, bool by_blocks)
      : file_(std::move(file)), bytes_(bytes), by_blocks_(by_blocks) {}

  void begin(tbb::task_group& tasks) {
    if (!by_blocks_) {
      tasks.run([this] { hashWhole(); });
      return;
    }
    digests_.resize(static_cast<std::size_t>((bytes_ + kHashBlockBytes - 1) / kHashBlockBytes));
    for (std::size_t first = 0; first < digests_.size(); first += kHashBlocksPerTask) {
      tasks.run([this, first] { hashBlocks(first, std::min(first + kHashBlocksPerTask, digests_.size())); });
    }
  }

  /// After the tasks. @return empty if the file could not be read as a whole
  [[nodiscard]] std::string hash() {
    if (failed_) return {};
    if (!by_blocks_) return whole_;
    internal::Sha256 sha256;
    for (const internal::Sha256::Digest& digest : digests_) sha256.update(digest.data(), digest.size());
    return internal::hexOf(sha256.digest());
  }

 private:
  void hashWhole() {
    try {
      whole_ = sha256OfFile(file_);
    } catch (const std::exception&) {
      failed_ = true;
    }
  }

  void hashBlocks(std::size_t first, std::size_t end) {
    try {
      const InputDescriptor input(file_);
      std::vector<char> block(kHashBlockBytes);
      for (std::size_t n = first; n < end && !failed_; ++n) {
        const std::uint64_t at = static_cast<std::uint64_t>(n) * kHashBlockBytes;
        const auto wanted = static_cast<std::size_t>(std::min<std::uint64_t>(kHashBlockBytes, bytes_ - at));
        if (input.readAt(at, block.data(), wanted) != wanted) failed_ = true;
        internal::Sha256 sha256;
        sha256.update(block.data(), wanted);
        digests_[n] = sha256.digest();
      }
    } catch (const std::exception&) {
      failed_ = true;
    }
  }

  fs::path file_;
  std::uint64_t bytes_;
  bool by_blocks_;
  std::vector<internal::Sha256::Digest> digests_;
  std::string whole_;
  std::atomic<bool> failed_ = false;
};

bool isHash(const std::string& text) {
  return text.size() == 64 && text.find_first_not_of("0123456789abcdef") == std::string::npos;
}

/// What a folder's record says of one file.
struct RecordedOutput {
  std::optional<std::uint64_t> bytes;
  std::string hash;
  bool by_blocks = false;
};

/// What a folder says of its files: report.json, or tile.json.
struct OutputRecord {
  std::string name;  ///< of the file that says it; empty: no hashes
  std::string why;   ///< there are none
  std::map<std::string, RecordedOutput> outputs;

  static OutputRecord read(const fs::path& folder) {
    OutputRecord record;
    record.why = "no report.json with hashes lies beside it";
    for (const char* name : {"report.json", "tile.json"}) {
      const fs::path file = folder / name;
      if (!isFile(file)) continue;
      const Json json = Json::parse(contentAt(file, kLargestRecord), nullptr, false);
      if (json.is_discarded() || !json.is_object()) {
        record.why = std::string(name) + " beside it is damaged";
      } else if (record.take(name, json)) {
        return record;
      }
    }
    return record;
  }

 private:
  bool take(const std::string& file, const Json& json) {
    const bool of_run = file == "report.json";
    const auto found = json.find(of_run ? "outputs" : "files");
    if (found == json.end() || !(of_run ? found->is_array() : found->is_object())) return false;
    name = file;
    if (!of_run) {
      for (const auto& [path, sha256] : found->items()) outputs[path] = {std::nullopt, textOf(sha256), false};
      return true;
    }
    for (const Json& entry : *found) {
      if (!entry.is_object()) continue;
      RecordedOutput output = {std::nullopt, textOf(entry.value("sha256_of_blocks", Json())), true};
      if (const Json bytes = entry.value("bytes", Json()); bytes.is_number_unsigned()) output.bytes = bytes;
      outputs[textOf(entry.value("path", Json()))] = output;
    }
    return true;
  }
  static std::string textOf(const Json& value) { return value.is_string() ? value.get<std::string>() : std::string(); }
};

}  // namespace

std::string sha256OfBlocks(const fs::path& file) {
  HashInTasks hash(file, inputFileSize(file), /*by_blocks=*/true);
  tbb::task_group tasks;
  hash.begin(tasks);
  tasks.wait();
  std::string text = hash.hash();
  if (text.empty()) {
    throw InputError("input.unreadable", file.string(), "reading failed", "Check the disk and permissions");
  }
  return text;
}

struct ACCESSVDB_PRIVATE OutputCheck::Impl {
  struct Begun {
    fs::path file;
    std::string record, advice, expected;
    std::string problem;  ///< known without reading it
    std::optional<HashInTasks> hash;
  };

  explicit Impl(bool allow) : allow_changed(allow) {}

  /// @return false if this file was begun before, or is none
  bool isNew(const fs::path& file) { return isFile(file) && known.insert(file.lexically_normal()).second; }

  void add(const fs::path& file, const RecordedOutput& expected, const std::string& record, const std::string& advice) {
    Begun& one = begun.emplace_back();
    one.file = file;
    one.record = record;
    one.advice = advice;
    one.expected = expected.hash;
    const std::uint64_t bytes = inputFileSize(file);
    if (!isHash(expected.hash)) {
      one.problem = "is not the file of this run, or " + record + " has changed: it holds no usable hash of it";
    } else if (expected.bytes && *expected.bytes != bytes) {
      one.problem = "has changed since it was written: it holds " + std::to_string(bytes) + " bytes where " + record +
                    " says " + std::to_string(*expected.bytes);
    } else {
      one.hash.emplace(file, bytes, expected.by_blocks);
      one.hash->begin(tasks);
    }
  }

  const bool allow_changed;
  std::deque<Begun> begun;
  std::set<fs::path> known;
  std::map<fs::path, OutputRecord> records;
  std::vector<std::pair<std::string, std::string>> warnings;
  std::vector<std::string> notices;
  tbb::task_group tasks;
};

OutputCheck::OutputCheck(bool allow_changed) : impl_(std::make_unique<Impl>(allow_changed)) {}

OutputCheck::~OutputCheck() {
  impl_->tasks.cancel();
  impl_->tasks.wait();
}

void OutputCheck::begin(const fs::path& folder, const std::vector<std::string>& names) {
  auto record = impl_->records.find(folder);
  std::string unchecked, unlisted;
  const auto append = [](std::string& list, const std::string& name) { list += (list.empty() ? "" : ", ") + name; };
  for (const std::string& name : names) {
    if (!impl_->isNew(folder / name)) continue;
    if (record == impl_->records.end()) record = impl_->records.emplace(folder, OutputRecord::read(folder)).first;
    const auto found = record->second.outputs.find(name);
    if (found != record->second.outputs.end()) {
      impl_->add(folder / name, found->second, record->second.name, kChangedAdvice);
    } else {
      append(record->second.name.empty() ? unchecked : unlisted, name);
    }
  }
  if (!unchecked.empty())
    impl_->notices.push_back((folder / unchecked).string() + " read without a check: " + record->second.why);
  if (!unlisted.empty()) {
    impl_->warnings.emplace_back("output.unlisted", (folder / unlisted).string() +
                                                        " read without a check: " + record->second.name +
                                                        " has hashes, but none of it; is it from another run?");
  }
}

void OutputCheck::begin(const fs::path& file, const std::string& sha256, const std::string& record,
                        const std::string& advice) {
  if (!impl_->isNew(file)) return;
  if (sha256.empty()) {
    impl_->notices.push_back(file.string() + " read without a check: " + record + " has no hash of it");
  } else {
    impl_->add(file, {std::nullopt, sha256, false}, record, advice);
  }
}

void OutputCheck::finish() {
  impl_->tasks.wait();
  std::deque<Impl::Begun> begun;
  begun.swap(impl_->begun);
  std::optional<InputError> first;
  for (Impl::Begun& one : begun) {
    std::string problem = one.problem;
    if (problem.empty() && one.hash->hash() != one.expected)
      problem = "has changed since it was written: its content is not that of which " + one.record + " has the hash";
    if (problem.empty()) continue;
    if (impl_->allow_changed) {
      impl_->warnings.emplace_back("output.changed", one.file.string() + " " + problem + "; read all the same");
    } else if (!first) {
      first.emplace("output.changed", one.file.string(), problem, one.advice);
    }
  }
  if (first) throw InputError(*first);
}

const std::vector<std::pair<std::string, std::string>>& OutputCheck::warnings() const { return impl_->warnings; }
const std::vector<std::string>& OutputCheck::notices() const { return impl_->notices; }

}  // namespace accessvdb::io
