// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Recordings with bytes changed at random: an error or a result, never a crash, and never more memory than allowed.
/// For long runs under sanitizers: $ACCESSVDB_MUTATIONS is the number for each of the recordings, $ACCESSVDB_SEED gives
/// other changes, and $ACCESSVDB_RECORDINGS is a folder in which a run with the writers leaves its recordings, and
/// where a machine without them finds them.
#include <sys/resource.h>

#include <fstream>
#include <sstream>

#include "campaign/mutator.h"
#include "recordings/flight.h"

namespace accessvdb::recordings_test {
namespace {

std::string contentOf(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream bytes;
  bytes << in.rdbuf();
  return bytes.str();
}

int numberFrom(const char* variable, int usual) {
  const char* const text = std::getenv(variable);
  return text != nullptr ? std::atoi(text) : usual;
}

long peakBytes() {
  rusage usage = {};
  ::getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss * 1024;
}

class RecordingMutations : public FlightTest {
 protected:
  /// Some of the changes hit what does not matter, and some what does.
  void TearDown() override {
    EXPECT_TRUE(IsSkipped() || (read_ > 0 && refused_ > 0)) << read_ << " read, " << refused_ << " refused";
  }

  [[nodiscard]] static fs::path keptIn(const std::string& name) {
    const char* const folder = std::getenv("ACCESSVDB_RECORDINGS");
    return folder != nullptr ? fs::path(folder) / name : fs::path();
  }
  [[nodiscard]] static bool isKept(const std::string& name) { return fs::exists(keptIn(name)); }

  /// Written by another program, unless one is kept.
  [[nodiscard]] fs::path recording(const std::string& name, const std::string& options) const {
    if (isKept(name)) return keptIn(name);
    const fs::path made = write(name, options);
    if (!keptIn(name).empty()) fs::copy(made, keptIn(name));
    return made;
  }

  void mutate(const fs::path& recording) {
    const int count = numberFrom("ACCESSVDB_MUTATIONS", 60);
    const std::string whole = contentOf(recording);
    ASSERT_GT(whole.size(), 100U);
    const fs::path file = folder_.path() / ("mutated" + recording.extension().string());
    campaign::Mutator mutator(static_cast<unsigned>(whole.size()) +
                              1000003U * static_cast<unsigned>(numberFrom("ACCESSVDB_SEED", 0)));
    const long before = peakBytes();
    for (int i = 0; i < count; ++i) {
      const std::string bytes = mutator(whole);
      std::ofstream(file, std::ios::binary) << bytes;
      try {
        io::ScanSequence scans = io::ScanSequence::open({.scans = file, .allow_truncated = i % 4 == 0});
        for (std::size_t step = 0; step < scans.size(); ++step) (void)scans.read(step);
        (void)scans.heldBytes();
        ++read_;
      } catch (const Error& error) {
        EXPECT_NE(error.code(), ErrorCode::Internal) << error.what();
        EXPECT_FALSE(error.advice().empty()) << error.what();
        EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos) << error.what();
        ++refused_;
      }
    }
    // 64 MiB and the largest chunk, which is below 1 MiB here. Sanitizers keep what was freed.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    EXPECT_LT(peakBytes() - before, 65L << 20) << recording;
#else
    (void)before;
#endif
  }

 private:
  int read_ = 0, refused_ = 0;
};

TEST_F(RecordingMutations, OfMcapAreReadOrRefused) {
  if (!isKept("c.mcap")) ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(4, 30);
  mutate(recording("a.mcap", "chunk=0"));
  mutate(recording("b.mcap", "compression=zstd chunk=700 layout=organised"));
  mutate(recording("c.mcap", "compression=lz4 clouds=livox index=no poses=tf"));
}

TEST_F(RecordingMutations, OfDatabasesAreReadOrRefused) {
  if (!isKept("a.db3")) ACCESSVDB_NEED_ROS2_WRITER();
  writeFlight(4, 30);
  mutate(recording("a.db3", "poses=tf"));
}

TEST_F(RecordingMutations, OfRosBagsAreReadOrRefused) {
  if (!isKept("c.bag")) ACCESSVDB_NEED_ROS1_WRITER();
  writeFlight(4, 30);
  mutate(recording("a.bag", ""));
  mutate(recording("b.bag", "compression=lz4 chunk=700 clouds=livox"));
  mutate(recording("c.bag", "compression=bz2 poses=tf"));
}

}  // namespace
}  // namespace accessvdb::recordings_test
