// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Stored scans equal the simulator's, or they are not used.
#include "eval/scan_store.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <functional>
#include <sstream>

#include "sim/simulator.h"

namespace accessvdb::eval {
namespace {

namespace fs = std::filesystem;

class ScanStoreTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = fs::path(testing::TempDir()) /
              (std::string("scan_store_") + testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(folder_);
    observer_.say = [this](const std::string& line) { said_ += line + "\n"; };
  }
  void TearDown() override { fs::remove_all(folder_); }

  std::shared_ptr<const StoredScans> get(const ScanRequest& request) {
    said_.clear();
    return ScanStore(folder_, observer_).get(request);
  }
  [[nodiscard]] fs::path onlyFile() const {
    EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1);
    return fs::directory_iterator(folder_)->path();
  }
  [[nodiscard]] std::string content() const {
    std::ostringstream text;
    text << std::ifstream(onlyFile(), std::ios::binary).rdbuf();
    return text.str();
  }
  void replaceContent(const std::string& text) const {
    std::ofstream(onlyFile(), std::ios::binary | std::ios::trunc) << text;
  }
  static void expectSame(const StoredScans& a, const StoredScans& b) {
    ASSERT_EQ(a.frames.size(), b.frames.size());
    for (std::size_t n = 0; n < a.frames.size(); ++n) {
      EXPECT_EQ(a.frames[n].hits_S, b.frames[n].hits_S) << n;
      EXPECT_EQ(a.frames[n].T_W_S.matrix(), b.frames[n].T_W_S.matrix()) << n;
    }
  }

  fs::path folder_;
  Observer observer_;
  std::string said_;
};

const ScanRequest kRequest{"wall", 0.002, 6, 0.001, 1};

TEST_F(ScanStoreTest, HoldsWhatTheSimulatorMakes) {
  ScanStore store({}, observer_);
  const auto scans = store.get(kRequest);
  sim::LidarModel model = sim::LidarModel::named("mid360");
  model.range_noise_m = kRequest.range_noise_m;
  const sim::Simulator simulator(scans->benchmark.scene, model, scans->benchmark.trajectory, 1);
  ASSERT_EQ(scans->frames.size(), 6u);
  std::uint64_t returns = 0;
  for (int n = 0; n < 6; ++n) {
    const sim::SimulatedFrame frame = simulator.frame(n);
    std::vector<Eigen::Vector3f> hits;
    for (const auto& p : frame.points_S) {
      if (!p.isZero(0)) hits.push_back(p);
    }
    EXPECT_EQ(scans->frames[static_cast<std::size_t>(n)].hits_S, hits);
    returns += hits.size();
  }
  EXPECT_GT(returns, 100u);
  EXPECT_EQ(scans->returns(), returns);
  EXPECT_EQ(store.get(kRequest), scans);  // the same object, not cast twice
  ScanRequest other = kRequest;
  other.range_noise_m = 0;
  EXPECT_NE(store.get(other)->frames[0].hits_S, scans->frames[0].hits_S);
  other = kRequest;
  other.seed = 2;
  EXPECT_NE(store.get(other)->frames[0].hits_S, scans->frames[0].hits_S);
}

TEST_F(ScanStoreTest, AFileGivesTheSameBytesAndIsNotWrittenAgain) {
  const auto made = get(kRequest);
  EXPECT_EQ(said_, "");
  const std::string file = content();
  const auto written_at = fs::last_write_time(onlyFile());
  const auto read = get(kRequest);
  EXPECT_EQ(said_, "");
  expectSame(*made, *read);
  EXPECT_EQ(content(), file);
  EXPECT_EQ(fs::last_write_time(onlyFile()), written_at);
}

TEST_F(ScanStoreTest, WhatDoesNotFitIsMadeAgainAndSaid) {
  const auto made = get(kRequest);
  const std::string good = content();

  struct Damage {
    const char* words;
    std::function<std::string(std::string)> apply;
  };
  const Damage damages[] = {
      {"another version", [](std::string s) { return s.replace(s.find("scans 1"), 7, "scans 0"); }},
      {"another version", [](std::string) { return std::string("no scans at all"); }},
      {"cannot be read", [](std::string) { return std::string(); }},
      {"have changed", [](std::string s) { return s.replace(s.find("seed 1"), 6, "seed 9"); }},
      {"damaged", [](std::string s) { return s.substr(0, s.size() / 2); }},
      {"damaged",
       [](std::string s) {
         s[s.size() / 2] = static_cast<char>(s[s.size() / 2] ^ 1);
         return s;
       }},
  };
  for (const Damage& damage : damages) {
    replaceContent(damage.apply(good));
    const auto again = get(kRequest);
    EXPECT_NE(said_.find(damage.words), std::string::npos) << damage.words << ": " << said_;
    EXPECT_EQ(std::count(said_.begin(), said_.end(), '\n'), 1) << said_;
    expectSame(*made, *again);
    EXPECT_EQ(content(), good);
  }
}

TEST_F(ScanStoreTest, AWholeFileOfAnotherSimulatorIsNoticed) {
  // As if the simulator had changed without its description: a valid file with different frames under this name.
  const auto made = get(kRequest);
  const std::string name = onlyFile().string();
  ScanRequest other = kRequest;
  other.range_noise_m = 0.002;
  fs::remove(name);
  (void)get(other);
  std::string forged = content();
  fs::remove(onlyFile());
  (void)get(kRequest);
  const std::string good = content();
  // Same header as the good file, the other's frames, checksum recomputed: the simplest way is to let the store write
  // it.
  const std::size_t head = good.find('\n', good.find('\n') + 1) + 1;
  const std::size_t other_head = forged.find('\n', forged.find('\n') + 1) + 1;
  std::string body = good.substr(0, head) + forged.substr(other_head, forged.size() - other_head - 16);
  std::uint64_t hash = 0xcbf29ce484222325u;
  for (const char c : body) hash = (hash ^ static_cast<unsigned char>(c)) * 0x100000001b3u;
  char checksum[17];
  std::snprintf(checksum, sizeof checksum, "%016llx", static_cast<unsigned long long>(hash));
  replaceContent(body + checksum);
  const auto again = get(kRequest);
  EXPECT_NE(said_.find("not those of this program"), std::string::npos) << said_;
  expectSame(*made, *again);
}

TEST_F(ScanStoreTest, StopsWhenAsked) {
  observer_.stop = [] { return true; };
  EXPECT_THROW((void)get(kRequest), StopRequested);
}

TEST_F(ScanStoreTest, RefusesAnUnknownScene) {
  ScanRequest request = kRequest;
  request.scene = "teapot";
  EXPECT_ANY_THROW((void)get(request));
}

}  // namespace
}  // namespace accessvdb::eval
