// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "output/program.h"

#include <algorithm>
#include <csignal>
#include <cstring>
#include <new>

#include "accessvdb/config.h"
#include "options/command_line.h"
#include "output/last_line.h"

namespace accessvdb::tools {
namespace {

std::vector<Verb> listedVerbs(const Program& program) {
  std::vector<Verb> verbs = program.verbs;
  std::erase_if(verbs, [](const Verb& verb) { return *verb.purpose == '\0'; });
  return verbs;
}

std::string version(const Program& program) { return std::string(program.name) + " " ACCESSVDB_VERSION; }

std::string overview(const Program& program) {
  const std::string name = program.name;
  const std::vector<Verb> verbs = listedVerbs(program);
  std::size_t width = 0;
  for (const Verb& verb : verbs) width = std::max(width, std::strlen(verb.name));
  std::string text = version(program) + ": " + program.purpose + "\n\nUsage: " + name + " VERB [options]\n\nVerbs:\n";
  for (const Verb& verb : verbs)
    text += std::string("  ") + verb.name + std::string(width + 2 - std::strlen(verb.name), ' ') + verb.purpose + "\n";
  return text + "\n" + name + " VERB --help lists a verb's options.\n\nExample:\n  " + program.example + "\n";
}

std::string verbList(const Program& program) {
  const std::vector<Verb> verbs = listedVerbs(program);
  std::string list;
  for (const Verb& verb : verbs)
    list += (list.empty() ? "" : &verb == &verbs.back() ? " and " : ", ") + std::string(verb.name);
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

int dispatch(const Program& program, const Arguments& arguments, Messages& messages) {
  const std::string advice = std::string("See ") + program.name + " --help";
  if (arguments.empty())
    throw InvalidArgument("usage.verb", "", "no verb given; the verbs are " + verbList(program), advice);
  const std::string& word = arguments.front();
  if (word == "--help" || word == "-h" || word == "--version") {
    printData(word == "--version" ? version(program) + "\n" : overview(program));
    return 0;
  }
  for (const Verb& verb : program.verbs) {
    if (word == verb.name) return verb.run(Arguments(arguments.begin() + 1, arguments.end()), messages);
  }
  throw InvalidArgument("usage.verb", word, "is not a verb; the verbs are " + verbList(program), advice);
}

}  // namespace

int runProgram(const Program& program, int argc, char** argv) {
  std::signal(SIGXFSZ, SIG_IGN);  // a file size limit must show up as a failed write, which is code 7
  const Arguments arguments(argv + 1, argv + argc);
  Messages messages(wantedFormat(arguments), false);
  try {
    return dispatch(program, arguments, messages);
  } catch (const std::exception& error) {
    try {
      const Failure failure = describeFailure(error);
      messages.error(failure);
      return failure.exit_code;
    } catch (const std::bad_alloc&) {
      endOutOfMemory();
    }
  }
}

}  // namespace accessvdb::tools
