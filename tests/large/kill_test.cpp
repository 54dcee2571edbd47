// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// SIGKILL at random moments of every step: the same command goes on, the bytes are the same in the end, and nothing
/// temporary is left. ACCESSVDB_KILLS sets how many, ACCESSVDB_SEED which.
#include <algorithm>
#include <iostream>
#include <random>

#include "large/tiled_test.h"

namespace accessvdb::large_test {
namespace {

namespace fs = std::filesystem;

/// A step, and the folder as it is before it.
struct KilledStep {
  std::string name;
  Flags arguments;
  std::string before;  ///< empty: no folder
  double seconds = 0;  ///< when nobody kills it
};

class TileKills : public TiledTest {
 protected:
  void copy(const std::string& from, const std::string& to) const {
    fs::remove_all(folder_ / to);
    if (!from.empty()) fs::copy(folder_ / from, folder_ / to, fs::copy_options::recursive);
  }
};

TEST_F(TileKills, GoOnToTheSameBytes) {
  const int kills = countFrom("ACCESSVDB_KILLS", 12), seed = countFrom("ACCESSVDB_SEED", 1);
  std::cout << "kills " << kills << ", seed " << seed << "\n";
  RecordProperty("seed", seed);
  std::mt19937_64 random(static_cast<std::uint64_t>(seed));
  std::vector<KilledStep> steps = {{"map", map({"--tiles", "6.4"}), "", 0},
                                   {"run", step("run"), "binned", 0},
                                   {"merge", step("merge", {"--vdb", path("all.vdb")}), "mapped", 0},
                                   {"bin", step("bin"), "planned", 0},
                                   {"plan", plan({"--tiles", "6.4"}), "", 0},
                                   {"fresh", map({"--tiles", "6.4", "--fresh"}), "mapped", 0}};
  succeed(plan({"--tiles", "6.4"}, "planned"));
  copy("planned", "binned");
  succeed(step("bin", {}, "binned"));
  copy("binned", "mapped");
  succeed(step("run", {}, "mapped"));
  for (KilledStep& killed : steps) {
    copy(killed.before, "out");
    killed.seconds = runToItsEnd(killed.arguments).seconds;
  }

  int hits = 0;
  for (int n = 0; n < kills && !HasFailure(); ++n) {
    KilledStep& step_killed = steps[static_cast<std::size_t>(n) % steps.size()];
    SCOPED_TRACE(step_killed.name + ", kill " + std::to_string(n) + " of seed " + std::to_string(seed));
    const double share = std::uniform_real_distribution<double>(0, 0.95)(random);
    Ending ending;
    // If the kill comes too late, because the machine was slower when the step was timed, it comes sooner the next
    // time.
    for (int tries = 0; tries < 3 && !ending.killed; ++tries) {
      copy(step_killed.before, "out");
      fs::remove(path("all.vdb"));
      ending = runToItsEnd(step_killed.arguments, share * step_killed.seconds);
      if (!ending.killed) step_killed.seconds = std::min(step_killed.seconds, ending.seconds);
    }
    hits += ending.killed ? 1 : 0;
    EXPECT_TRUE(ending.killed || ending.exit_code == 0);

    // The same command again, then what is still to do.
    succeed(step_killed.arguments);
    if (step_killed.name == "plan") succeed(step("bin"));
    if (step_killed.name == "plan" || step_killed.name == "bin") succeed(step("run"));
    expectOnePiece();
    expectNoLeftovers();
  }
  RecordProperty("hits", hits);
  std::cout << hits << " of " << kills << " killed a running process\n";
  EXPECT_GE(hits, 0.8 * kills);
}

}  // namespace
}  // namespace accessvdb::large_test
