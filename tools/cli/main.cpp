// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// accessvdb VERB [options]: finds the verb, and turns anything that it throws into one line and an exit code.
#include <csignal>
#include <iterator>

#include "accessvdb/config.h"
#include "command_line.h"
#include "stop_signal.h"
#include "verbs.h"

namespace {

using namespace accessvdb::tools;

struct Verb {
  const char* name;
  const char* purpose;
  int (*run)(const Arguments&, Messages&);
};

constexpr Verb kVerbs[] = {
    {"map", "scans, poses and a tool in; the accessibility field out", runMap},
    {"tile", "the same for maps larger than memory, step by step", runTile},
    {"advise", "what to map given scans with: voxel, range noise, tau, tiles", runAdvise},
    {"live", "labels while the scanner runs: topics of ROS 2 in and out", runLive},
    {"simulate", "scans of a known scene, for trying things out", runSimulate},
    {"evaluate", "the tables: simulated scans against exact ground truth", runEvaluate},
    {"bench", "a simulated flight through pines, every stage timed", runBench},
    {"info", "what is inside a .vdb file or an output folder", runInfo},
    {"query", "label, reason and best direction at given points", runQuery},
    {"diff", "what changed between two maps of the same place", runDiff},
    {"whatif", "what a cut would open, and in which order to cut", runWhatIf},
    {"render", "a picture of a field or of a tool, no display needed", runRender},
    {"report", "a field as one page for a browser, no network needed", runReport},
};

std::string overview() {
  std::string text = "accessvdb " ACCESSVDB_VERSION
                     ": which surfaces can this tool reach, from which direction, and if not, why not\n\n"
                     "Usage: accessvdb VERB [options]\n\nVerbs:\n";
  for (const Verb& verb : kVerbs)
    text += std::string("  ") + verb.name + std::string(10 - std::string(verb.name).size(), ' ') + verb.purpose + "\n";
  return text +
         "\naccessvdb VERB --help lists a verb's options.\n\nExample:\n"
         "  accessvdb map --scans scans/ --poses poses.txt --tool builtin:pruner --voxel 0.02 --out out/\n";
}

std::string verbList() {
  std::string list;
  for (const Verb& verb : kVerbs)
    list += (list.empty() ? "" : &verb == std::end(kVerbs) - 1 ? " and " : ", ") + std::string(verb.name);
  return list;
}

/// The error format must be known before anything can fail, so it is found before parsing.
ErrorFormat wantedFormat(const Arguments& arguments) {
  for (std::size_t i = 0; i < arguments.size(); ++i) {
    if (arguments[i] == "--error-format=json") return ErrorFormat::Json;
    if (arguments[i] == "--error-format" && i + 1 < arguments.size() && arguments[i + 1] == "json")
      return ErrorFormat::Json;
  }
  return ErrorFormat::Text;
}

int dispatch(const Arguments& arguments, Messages& messages) {
  if (arguments.empty()) {
    throw accessvdb::InvalidArgument("usage.verb", "", "no verb given; the verbs are " + verbList(),
                                     "See accessvdb --help");
  }
  const std::string& word = arguments.front();
  if (word == "--help" || word == "-h" || word == "--version") {
    printData(word == "--version" ? "accessvdb " ACCESSVDB_VERSION "\n" : overview());
    return 0;
  }
  for (const Verb& verb : kVerbs) {
    if (word == verb.name) return verb.run(Arguments(arguments.begin() + 1, arguments.end()), messages);
  }
  throw accessvdb::InvalidArgument("usage.verb", word, "is not a verb; the verbs are " + verbList(),
                                   "See accessvdb --help");
}

}  // namespace

int main(int argc, char** argv) {
  std::signal(SIGXFSZ, SIG_IGN);  // a file size limit must show up as a failed write, which is code 7
  const Arguments arguments(argv + 1, argv + argc);
  Messages messages(wantedFormat(arguments), false);
  try {
    return dispatch(arguments, messages);
  } catch (const std::exception& error) {
    const Failure failure = describeFailure(error);
    messages.error(failure);
    return failure.exit_code;
  }
}
