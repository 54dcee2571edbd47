// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// rosbag2 databases (.db3): tables `topics` and `messages`, read through SQLite, which is told to trust nothing in
/// the file.
#include <algorithm>
#include <filesystem>
#include <system_error>
#include <unordered_map>
#include <utility>

#include "accessvdb/error.h"
#include "bags/chunk_bytes.h"
#include "bags/recording.h"
#include "bags/sqlite_file.h"

namespace accessvdb::bags {
namespace {

struct Closer {
  void operator()(sqlite3* database) const { ::sqlite3_close(database); }
  void operator()(sqlite3_stmt* statement) const { ::sqlite3_finalize(statement); }
};
using Database = std::unique_ptr<sqlite3, Closer>;
using Statement = std::unique_ptr<sqlite3_stmt, Closer>;

class SqliteReader final : public Recording {
 public:
  SqliteReader(std::unique_ptr<ByteInput> input, const OpenRecording& open) : open_(open), file_(std::move(input)) {
    for (const char* const journal : {"-wal", "-journal"}) {
      std::error_code error;
      const auto bytes = std::filesystem::file_size(open.path.string() + journal, error);
      if (error && error != std::errc::no_such_file_or_directory)
        throw InputError("input.unreadable", open.subject,
                         std::string("its journal (") + journal + ") cannot be looked at: " + error.message(),
                         "Check the file system");
      if (!error && bytes > 0)
        throw InputError("recording.journal", open.subject,
                         std::string("has messages in a journal (") + journal + ") that are not in the file yet",
                         "Close the recorder; after a crash, run: sqlite3 FILE 'PRAGMA wal_checkpoint(TRUNCATE)'");
    }
    sqlite3* raw = nullptr;
    const int status =
        ::sqlite3_open_v2("recording", &raw, SQLITE_OPEN_READONLY | SQLITE_OPEN_NOMUTEX, file_.vfsName());
    database_.reset(raw);
    if (status != SQLITE_OK) refuse();
    ::sqlite3_db_config(raw, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
    ::sqlite3_db_config(raw, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
    ::sqlite3_limit(raw, SQLITE_LIMIT_LENGTH, static_cast<int>(kMostChunkBytes));
    ::sqlite3_limit(raw, SQLITE_LIMIT_ATTACHED, 0);
    (void)::sqlite3_exec(raw, "PRAGMA cell_size_check=ON", nullptr, nullptr, nullptr);
    (void)::sqlite3_exec(raw, "PRAGMA mmap_size=0", nullptr, nullptr, nullptr);
    requireTables();
    readTopics();
  }

  void scan(const Wanted& wanted, const Use& use) override {
    const Statement rows = prepare("SELECT rowid, topic_id, timestamp, data FROM messages NOT INDEXED ORDER BY rowid");
    for (;;) {
      const int status = ::sqlite3_step(rows.get());
      if (status == SQLITE_DONE) return;
      if (status != SQLITE_ROW) {
        if (file_.missingBytes() == 0 && !open_.allow_truncated) refuse();
        cut_off_ = file_.missingBytes() > 0
                       ? "is cut off: its last " + std::to_string(file_.missingBytes()) + " bytes are missing"
                       : "is damaged: " + wordFrom(::sqlite3_errmsg(database_.get()));
        return;
      }
      const auto topic = topic_.find(::sqlite3_column_int64(rows.get(), 1));
      if (topic == topic_.end())
        throw InputError("recording.damaged", open_.subject, "has a message of a topic that is not in its list",
                         "Copy the file again");
      const std::int64_t logged_ns = ::sqlite3_column_int64(rows.get(), 2);
      count(topic->second, logged_ns);
      if (!wanted(topics_[topic->second])) continue;
      Place place;
      place.block = static_cast<std::uint64_t>(::sqlite3_column_int64(rows.get(), 0));
      const std::string_view bytes = blob(rows.get(), 3);
      place.bytes = static_cast<std::uint32_t>(bytes.size());
      use({topic->second, logged_ns, bytes, place});
    }
  }

  [[nodiscard]] std::string_view read(const Place& place) override {
    if (!row_) row_ = prepare("SELECT data FROM messages WHERE rowid = ?");
    ::sqlite3_reset(row_.get());
    ::sqlite3_bind_int64(row_.get(), 1, static_cast<std::int64_t>(place.block));
    if (::sqlite3_step(row_.get()) != SQLITE_ROW)
      throw InputError("input.changed", open_.subject, "changed since it was first read", "Wait until it is complete");
    const std::string_view bytes = blob(row_.get(), 0);
    if (bytes.size() != place.bytes)
      throw InputError("input.changed", open_.subject, "changed since it was first read", "Wait until it is complete");
    largest_ = std::max<std::uint64_t>(largest_, bytes.size());
    return bytes;
  }

  [[nodiscard]] std::uint64_t heldBytes() const override {
    constexpr std::uint64_t kPages = std::uint64_t{4} << 20;  // SQLite's own cache
    return kPages + largest_;
  }

 private:
  [[noreturn]] void refuse() const {
    const std::string reason = ::sqlite3_errmsg(database_.get());
    const bool other = ::sqlite3_errcode(database_.get()) == SQLITE_NOTADB;
    throw InputError(
        other ? "recording.format" : "recording.damaged", open_.subject,
        other ? "is not an SQLite database, as .db3 recordings are" : "cannot be read: " + wordFrom(reason),
        other ? "Check the file's name, or copy it again"
              : "Copy the file again, or use allow_truncated to read what comes before");
  }

  [[nodiscard]] Statement prepare(const char* query) const {
    sqlite3_stmt* raw = nullptr;
    const int status = ::sqlite3_prepare_v2(database_.get(), query, -1, &raw, nullptr);
    Statement statement(raw);
    if (status == SQLITE_ERROR)
      throw InputError("recording.format", open_.subject,
                       "is not a recording of rosbag2: " + wordFrom(::sqlite3_errmsg(database_.get())),
                       "Name a .db3 file that ros2 bag record has written");
    if (status != SQLITE_OK || !statement) refuse();
    return statement;
  }

  /// Views could compute anything, at any cost.
  void requireTables() const {
    const Statement tables = prepare(
        "SELECT count(*) FROM sqlite_master WHERE type = 'table' AND name IN ('topics', 'messages') AND sql NOT LIKE "
        "'%VIRTUAL%' AND sql NOT LIKE '%GENERATED%' AND sql NOT LIKE '% AS (%'");
    const int status = ::sqlite3_step(tables.get());
    if (status != SQLITE_ROW) refuse();
    if (::sqlite3_column_int(tables.get(), 0) != 2)
      throw InputError("recording.format", open_.subject,
                       "is not a recording of rosbag2: it has no plain tables 'topics' and 'messages'",
                       "Name a .db3 file that ros2 bag record has written");
  }

  void readTopics() {
    const Statement rows = prepare("SELECT id, name, type, serialization_format FROM topics");
    int status = SQLITE_ROW;
    while ((status = ::sqlite3_step(rows.get())) == SQLITE_ROW) {
      const std::string_view name = blob(rows.get(), 1), type = blob(rows.get(), 2), encoding = blob(rows.get(), 3);
      const bool valid = name.size() <= 4096 && type.size() <= 256 && encoding.size() <= 64;
      const auto topic = valid ? addTopic(name, type, encoding) : std::nullopt;
      if (!topic)
        throw InputError("recording.damaged", open_.subject, "has more or longer topics than a recorder writes",
                         "Copy the file again");
      topic_[::sqlite3_column_int64(rows.get(), 0)] = *topic;
    }
    if (status != SQLITE_DONE) refuse();
  }

  [[nodiscard]] std::string_view blob(sqlite3_stmt* row, int column) const {
    const void* const data = ::sqlite3_column_blob(row, column);
    const int bytes = ::sqlite3_column_bytes(row, column);
    if (data == nullptr || bytes <= 0) {
      if (::sqlite3_errcode(database_.get()) == SQLITE_NOMEM) throw std::bad_alloc();
      return {};
    }
    return {static_cast<const char*>(data), static_cast<std::size_t>(bytes)};
  }

  OpenRecording open_;
  SqliteFile file_;
  Database database_;
  std::unordered_map<std::int64_t, std::size_t> topic_;
  Statement row_;
  std::uint64_t largest_ = 0;
};

}  // namespace

std::unique_ptr<Recording> openSqlite(std::unique_ptr<ByteInput> input, const OpenRecording& open) {
  return std::make_unique<SqliteReader>(std::move(input), open);
}

}  // namespace accessvdb::bags
