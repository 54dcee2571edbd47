// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb-lab VERB [options]: simulates scans, and measures accessvdb with them.
#include "lab_verbs.h"

#include "output/last_line.h"

int main(int argc, char** argv) {
  using namespace accessvdb::tools;
  endWithOneLine(argc, argv);
  const Program program = {kLab,
                           "simulated scans, and how well and how fast accessvdb maps them",
                           {{"simulate", "scans of a known scene, for trying things out", runSimulate},
                            {"evaluate", "the tables: simulated scans against exact ground truth", runEvaluate},
                            {"bench", "a simulated flight through pines, every stage timed", runBench}},
                           "accessvdb-lab simulate --scene torus --out torus/"};
  return runProgram(program, argc, argv);
}
