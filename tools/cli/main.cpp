// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb VERB [options]: maps scans, and answers what of them a tool can reach.
#include "accessvdb/error.h"
#include "output/last_line.h"
#include "verbs/verbs.h"

namespace {

using namespace accessvdb::tools;

[[noreturn]] void refuseLabVerb(const std::string& verb) {
  throw accessvdb::InvalidArgument("usage.lab", verb, "is a verb of accessvdb-lab",
                                   "Run accessvdb-lab " + verb + " with the same options");
}

int refuseSimulate(const Arguments&, Messages&) { refuseLabVerb("simulate"); }
int refuseBench(const Arguments&, Messages&) { refuseLabVerb("bench"); }

int runOrRefuseEvaluate(const Arguments& arguments, Messages& messages) {
  if (wantsConsistency(arguments)) return runEvaluateConsistency(arguments, messages);
  refuseLabVerb("evaluate");
}

}  // namespace

int main(int argc, char** argv) {
  endWithOneLine(argc, argv);
  const Program program = {
      "accessvdb",
      "which surfaces can this tool reach, from which direction, and if not, why not",
      {{"map", "scans, poses and a tool in; the accessibility field out", runMap},
       {"tile", "the same for maps larger than memory, step by step", runTile},
       {"advise", "what to map given scans with: voxel, range noise, tau, tiles", runAdvise},
       {"live", "labels while the scanner runs: topics of ROS 2 in and out", runLive},
       {"consistency", "how far labels from half of the scans agree with the rest", runConsistency},
       {"info", "what is inside a .vdb file or an output folder", runInfo},
       {"query", "label, reason and best direction at given points", runQuery},
       {"diff", "what changed between two maps of the same place", runDiff},
       {"approaches", "where to go first, and how: poses before, at and after contact", runApproaches},
       {"views", "where to look next: poses of the sensor that resolve most points", runViews},
       {"whatif", "what a cut would open, and in which order to cut", runWhatIf},
       {"render", "a picture of a field or of a tool, no display needed", runRender},
       {"report", "a field as one page for a browser, no network needed", runReport},
       {"export", "a field for QGIS, Foxglove and Rerun", runExport},
       {"simulate", "", refuseSimulate},
       {"evaluate", "", runOrRefuseEvaluate},
       {"bench", "", refuseBench}},
      "accessvdb map --scans scans/ --poses poses.txt --tool builtin:pruner --voxel 0.02 --out out/"};
  return runProgram(program, argc, argv);
}
