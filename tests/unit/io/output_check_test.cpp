// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Hashes of blocks against those of sha256sum, and what a folder without, with, and with wrong ones says.
#include "accessvdb/output_check.h"

#include <gtest/gtest.h>

#include <fstream>
#include <new>
#include <utility>

#include "accessvdb/error.h"
#include "support/scratch_folder.h"

namespace accessvdb {
namespace {

namespace fs = std::filesystem;
using test::ScratchFolder;

void put(const fs::path& file, const std::string& bytes) { std::ofstream(file, std::ios::binary) << bytes; }

std::string entry(const std::string& name, std::uint64_t bytes, const std::string& hash) {
  return R"({"path": ")" + name + R"(", "bytes": )" + std::to_string(bytes) + R"(, "sha256_of_blocks": ")" + hash +
         R"("})";
}

std::string idOf(io::OutputCheck& check) {
  try {
    check.finish();
  } catch (const InputError& error) {
    return error.id();
  }
  return {};
}

// split -b 1M FILE; for each part: sha256sum | xxd -r -p; of these sha256sum
TEST(OutputCheck, HashesAreThoseOfBlocks) {
  const ScratchFolder folder;
  put(folder / "empty", "");
  EXPECT_EQ(io::sha256OfBlocks(folder / "empty"), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  put(folder / "abc", "abc");
  EXPECT_EQ(io::sha256OfBlocks(folder / "abc"), "4f8b42c22dd3729b519ba6f68d2da7cc5b2d606d05daed5ad5128cc03e6c6358");
  put(folder / "block", std::string(1 << 20, 'a'));
  EXPECT_EQ(io::sha256OfBlocks(folder / "block"), "d4a677617c0095aa2b7a469b307fa178b3d36dfaa4755634e7af92cd27b2d3b2");
  put(folder / "more", std::string((40 << 20) + 5, 'b'));  // several tasks
  EXPECT_EQ(io::sha256OfBlocks(folder / "more"), "78ac1a45ccfc68f009f6bf0fcba578356f43e618d773141db53e257d4f9fdc9f");
  EXPECT_THROW((void)io::sha256OfBlocks(folder / "none"), InputError);
  EXPECT_THROW((void)io::sha256OfBlocks(folder.path()), InputError);
}

TEST(OutputCheck, TellsWhatIsUnchangedFromWhatIsNot) {
  const ScratchFolder folder;
  put(folder / "a", std::string(3 << 20, 'x'));
  const std::string hash = io::sha256OfBlocks(folder / "a");
  put(folder / "report.json", R"({"outputs": [)" + entry("a", 3 << 20, hash) + "]}");
  {
    io::OutputCheck check;
    check.begin(folder.path(), {"a", "absent"});
    EXPECT_EQ(idOf(check), "");
    EXPECT_TRUE(check.warnings().empty());
    EXPECT_TRUE(check.notices().empty());
  }
  std::string bytes(3 << 20, 'x');
  bytes[2 << 20] = 'y';
  for (const std::string& other : {bytes, bytes + "x", std::string()}) {
    put(folder / "a", other);
    io::OutputCheck check, allowing(true);
    for (io::OutputCheck* one : {&check, &allowing}) one->begin(folder.path(), {"a"});
    EXPECT_EQ(idOf(check), "output.changed");
    EXPECT_EQ(idOf(check), "") << "said once";
    EXPECT_EQ(idOf(allowing), "");
    ASSERT_EQ(allowing.warnings().size(), 1u);
    EXPECT_EQ(allowing.warnings()[0].first, "output.changed");
  }
}

TEST(OutputCheck, ReportsThatHaveNoHashes) {
  const ScratchFolder folder;
  put(folder / "a", "a");
  put(folder / "b", "b");
  const auto found = [&] {
    io::OutputCheck check;
    check.begin(folder.path(), {"a", "b"});
    EXPECT_EQ(idOf(check), "");
    return std::pair(check.warnings().size(), check.notices().size());
  };
  using Counts = std::pair<std::size_t, std::size_t>;
  EXPECT_EQ(found(), Counts(0, 1));
  for (const char* text : {"", "{", "[]", "null", "{}", R"({"outputs": 7})", R"({"schema": 1, "inputs": []})"}) {
    put(folder / "report.json", text);
    EXPECT_EQ(found(), Counts(0, 1)) << text;
  }
  for (const char* text : {R"({"outputs": []})", R"({"outputs": [1, {"path": 3}, {"path": "c"}]})"}) {
    put(folder / "report.json", text);
    EXPECT_EQ(found(), Counts(1, 0)) << text;
  }
}

TEST(OutputCheck, WhatHasChangedGoesBeforeWhatItsReaderSays) {
  const ScratchFolder folder;
  put(folder / "a", "a");
  put(folder / "report.json", R"({"outputs": [)" + entry("a", 1, io::sha256OfBlocks(folder / "a")) + "]}");
  const auto failing = [](io::OutputCheck& check) {
    return io::readChecked(check, []() -> int { throw std::bad_alloc(); });
  };
  io::OutputCheck good;
  good.begin(folder.path(), {"a"});
  EXPECT_THROW((void)failing(good), std::bad_alloc);
  put(folder / "a", "b");
  io::OutputCheck changed;
  changed.begin(folder.path(), {"a"});
  EXPECT_THROW((void)failing(changed), InputError);
}

TEST(OutputCheck, ATileAloneHasItsManifest) {
  const ScratchFolder folder;
  put(folder / "a", "abc");
  const std::string of_abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
  put(folder / "tile.json", R"({"files": {"a": ")" + of_abc + R"("}})");
  io::OutputCheck check, later;
  check.begin(folder.path(), {"a"});
  EXPECT_EQ(idOf(check), "");
  EXPECT_TRUE(check.notices().empty());
  put(folder / "a", "abd");
  later.begin(folder.path(), {"a"});
  EXPECT_EQ(idOf(later), "output.changed");
  io::OutputCheck known;
  known.begin(folder / "a", of_abc, "field.json", "Make it again");
  EXPECT_EQ(idOf(known), "output.changed");
}

}  // namespace
}  // namespace accessvdb
