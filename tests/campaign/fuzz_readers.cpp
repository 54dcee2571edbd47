// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// Gives changed files to everything that reads files, in processes of its own.
///
///     fuzz_readers CORPUS --runs 100000 --seed 1 [--reader NAME] [--workers 2] [--keep FOLDER]
///
/// CORPUS/READER/SET holds the files of one input; TARGETS in it names those that are changed, one at a time. A run is
/// wrong if it ends by a signal, takes more than 20 s or 2 GB, throws anything but a documented error of one line with
/// advice, or leaves a file. Run n of a seed is the same on every machine: --only N repeats it, and with --dump FOLDER
/// it only writes its files there and prints READER SET FILE.
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "accessvdb/error.h"
#include "campaign/mutator.h"
#include "campaign/readers.h"

namespace accessvdb::campaign {
namespace {

namespace fs = std::filesystem;

constexpr unsigned kMostSeconds = 20;
constexpr rlim_t kMostBytes = rlim_t{2} << 30;
constexpr std::uint64_t kRunsOfAProcess = 500;

struct Options {
  fs::path corpus, keep;
  std::string reader;
  std::uint64_t runs = 10000, seed = 1, workers = 2;
  std::int64_t only = -1;
  fs::path dump;  ///< --only: the changed set goes there instead of being read
};

/// One file that is changed, and its surroundings.
struct Target {
  const Reader* reader;
  fs::path set, file;  ///< the file's path in the set
  std::string whole;
};

std::string contentOf(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream bytes;
  bytes << in.rdbuf();
  return bytes.str();
}

std::vector<std::vector<Target>> targetsOf(const Options& options) {
  std::vector<std::vector<Target>> targets;
  for (const Reader& reader : readers()) {
    const fs::path folder = options.corpus / reader.name;
    if ((!options.reader.empty() && options.reader != reader.name) || !fs::exists(folder)) continue;
    if (!reader.read && options.dump.empty()) continue;
    std::vector<fs::path> sets;
    for (const auto& set : fs::directory_iterator(folder)) sets.push_back(set.path());
    std::sort(sets.begin(), sets.end());
    targets.emplace_back();
    for (const fs::path& set : sets) {
      std::ifstream names(set / "TARGETS");
      for (std::string name; std::getline(names, name);)
        targets.back().push_back({&reader, set, name, contentOf(set / name)});
    }
    if (targets.back().empty()) targets.pop_back();
  }
  return targets;
}

/// What a process tells its parent, also if it crashes.
struct Progress {
  std::atomic<std::uint64_t> next;  ///< the run that it is in
  std::atomic<std::uint64_t> accepted, refused;
  char finding[512];  ///< of a run that ended by itself, but wrong
};

class Worker {
 public:
  Worker(const Options& options, const std::vector<std::vector<Target>>& targets, std::uint64_t number)
      : options_(options), targets_(targets), number_(number) {
    const char* const memory = fs::exists("/dev/shm") ? "/dev/shm" : "/tmp";
    scratch_ = fs::path(memory) / ("accessvdb_fuzz_" + std::to_string(getpid()) + "_" + std::to_string(number));
    void* const shared = mmap(nullptr, sizeof(Progress), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (shared == MAP_FAILED) std::abort();
    progress_ = new (shared) Progress{};
  }

  /// Runs number_, number_ + workers, ... @return how many were wrong
  std::uint64_t run() {
    std::uint64_t wrong = 0;
    const std::uint64_t first = options_.only >= 0 ? static_cast<std::uint64_t>(options_.only) : number_;
    const std::uint64_t end = options_.only >= 0 ? first + 1 : options_.runs;
    progress_->next = first;
    while (progress_->next < end) {
      progress_->finding[0] = '\0';
      const pid_t child = fork();
      if (child == 0) runSome(end);
      int status = 0;
      waitpid(child, &status, 0);
      if (WIFEXITED(status) && WEXITSTATUS(status) == 0) continue;
      ++wrong;
      report(progress_->next, status);
      progress_->next += options_.workers;
    }
    fs::remove_all(scratch_);
    return wrong;
  }

  void dump() const {
    const Target* target = nullptr;
    const std::string bytes = changed(static_cast<std::uint64_t>(options_.only), target);
    fs::remove_all(options_.dump);
    fs::copy(target->set, options_.dump, fs::copy_options::recursive);
    std::ofstream(options_.dump / target->file, std::ios::binary) << bytes;
    std::cout << target->reader->name << " " << target->set.filename().string() << " " << target->file.string() << "\n";
  }

  [[nodiscard]] std::uint64_t accepted() const { return progress_->accepted; }
  [[nodiscard]] std::uint64_t refused() const { return progress_->refused; }

 private:
  [[nodiscard]] std::string changed(std::uint64_t n, const Target*& target) const {
    Mutator mutator(options_.seed * 0x9e3779b97f4a7c15ULL + n);
    const auto& of_reader = targets_[n % targets_.size()];
    target = &of_reader[mutator.below(of_reader.size())];
    return mutator(target->whole);
  }

  [[nodiscard]] fs::path placeOf(const Target& target) const {
    return scratch_ / target.reader->name / target.set.filename();
  }

  [[noreturn]] void runSome(std::uint64_t end) {
    // What a reader prints is not what is looked at here.
    if (options_.only < 0 && (!freopen("/dev/null", "w", stdout) || !freopen("/dev/null", "w", stderr))) _exit(1);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    const rlimit memory = {kMostBytes, kMostBytes};
    setrlimit(RLIMIT_DATA, &memory);
#endif
    for (std::uint64_t k = 0; k < kRunsOfAProcess && progress_->next < end; ++k) {
      const std::uint64_t n = progress_->next;
      const Target* target = nullptr;
      const std::string bytes = changed(n, target);
      const fs::path place = placeOf(*target);
      if (!fs::exists(place)) {
        fs::create_directories(place.parent_path());
        fs::copy(target->set, place, fs::copy_options::recursive);
      }
      const std::size_t files = filesIn(place);
      std::ofstream(place / target->file, std::ios::binary) << bytes;
      alarm(kMostSeconds);
      const std::string finding = read(*target, place / target->file, n);
      alarm(0);
      std::ofstream(place / target->file, std::ios::binary) << target->whole;
      if (finding.empty() && target->reader->name != "report" && filesIn(place) != files) fail("left a file");
      if (!finding.empty()) fail(finding);
      progress_->next = n + options_.workers;
    }
    _exit(0);
  }

  static std::size_t filesIn(const fs::path& folder) {
    std::size_t count = 0;
    for ([[maybe_unused]] const auto& entry : fs::recursive_directory_iterator(folder)) ++count;
    return count;
  }

  [[noreturn]] void fail(const std::string& finding) {
    std::snprintf(progress_->finding, sizeof progress_->finding, "%s", finding.c_str());
    _exit(1);
  }

  /// @return what is wrong, or nothing
  std::string read(const Target& target, const fs::path& file, std::uint64_t n) {
    try {
      target.reader->read(file, n);
      const std::size_t opened = target.reader->opened ? target.reader->opened(file, target.set) : 0;
      ++progress_->accepted;
      return opened == 0 ? "" : std::to_string(opened) + " points are accessible only in the damaged one";
    } catch (const Error& error) {
      const std::string text = error.what();
      ++progress_->refused;
      if (options_.only >= 0) std::cerr << text << "\n";
      if (error.code() == ErrorCode::Internal) return "internal error: " + text;
      if (error.advice().empty()) return "no advice: " + text;
      if (text.find('\n') != std::string::npos) return "more than one line: " + text;
      return "";
    } catch (const std::exception& error) {
      return std::string("not a documented error: ") + error.what();
    }
  }

  void report(std::uint64_t n, int status) {
    const Target* target = nullptr;
    const std::string bytes = changed(n, target);
    std::string what = progress_->finding;
    if (WIFSIGNALED(status)) {
      what = WTERMSIG(status) == SIGALRM ? "took more than " + std::to_string(kMostSeconds) + " s"
                                         : std::string("signal ") + strsignal(WTERMSIG(status));
    } else if (what.empty()) {
      what = "ended with code " + std::to_string(WEXITSTATUS(status)) + " (a sanitizer?)";
    }
    const std::string line = "run " + std::to_string(n) + " of seed " + std::to_string(options_.seed) + ": " +
                             std::string(target->reader->name) + "/" + target->set.filename().string() + "/" +
                             target->file.string() + ": " + what + "\n";
    std::cout << line << std::flush;
    if (options_.keep.empty()) return;
    fs::create_directories(options_.keep);
    std::ofstream(options_.keep / (std::to_string(options_.seed) + "_" + std::to_string(n) + "_" +
                                   target->file.filename().string()),
                  std::ios::binary)
        << bytes;
  }

  const Options& options_;
  const std::vector<std::vector<Target>>& targets_;
  std::uint64_t number_;
  fs::path scratch_;
  Progress* progress_;
};

int campaign(const Options& options) {
  const auto targets = targetsOf(options);
  if (targets.empty()) {
    std::cerr << "fuzz_readers: no corpus in " << options.corpus << ": tests/campaign/corpus.py makes one\n";
    return 2;
  }
  if (!options.dump.empty()) {
    Worker(options, targets, 0).dump();
    return 0;
  }
  std::vector<pid_t> children;
  struct Sums {
    std::atomic<std::uint64_t> wrong, accepted, refused;
  };
  auto* const sums =
      static_cast<Sums*>(mmap(nullptr, sizeof(Sums), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0));
  const std::uint64_t workers = options.only >= 0 ? 1 : options.workers;
  for (std::uint64_t number = 0; number < workers; ++number) {
    const pid_t child = fork();
    if (child == 0) {
      Worker worker(options, targets, number);
      sums->wrong += worker.run();
      sums->accepted += worker.accepted();
      sums->refused += worker.refused();
      _exit(0);
    }
    children.push_back(child);
  }
  for (const pid_t child : children) waitpid(child, nullptr, 0);
  const std::uint64_t ended = sums->accepted + sums->refused;
  std::cout << ended << " runs over " << targets.size() << " readers: " << sums->accepted << " accepted, "
            << sums->refused << " refused, " << sums->wrong << " wrong\n";
  return sums->wrong == 0 && ended > 0 ? 0 : 1;
}

}  // namespace
}  // namespace accessvdb::campaign

int main(int argc, char** argv) {
  accessvdb::campaign::Options options;
  for (int i = 1; i < argc; ++i) {
    const std::string argument = argv[i];
    const auto value = [&] { return std::string(i + 1 < argc ? argv[++i] : ""); };
    if (argument == "--runs") {
      options.runs = std::stoull(value());
    } else if (argument == "--seed") {
      options.seed = std::stoull(value());
    } else if (argument == "--reader") {
      options.reader = value();
    } else if (argument == "--workers") {
      options.workers = std::max<std::uint64_t>(1, std::stoull(value()));
    } else if (argument == "--only") {
      options.only = std::stoll(value());
    } else if (argument == "--dump") {
      options.dump = value();
    } else if (argument == "--keep") {
      options.keep = value();
    } else {
      options.corpus = argument;
    }
  }
  return accessvdb::campaign::campaign(options);
}
