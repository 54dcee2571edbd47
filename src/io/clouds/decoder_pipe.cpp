// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
#include "io/clouds/decoder_pipe.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <stdexcept>
#include <thread>

#include "accessvdb/error.h"
#include "io/streams/input_file.h"
#include "io/streams/text_lines.h"

extern char** environ;

namespace accessvdb::io {
namespace {

/// A decoder may take its time before the first byte, but not forever.
constexpr std::chrono::seconds kSilence{300};
/// From the end of its output to the end of the decoder.
constexpr std::chrono::seconds kFarewell{10};
constexpr std::size_t kErrorBytes = 4096;  ///< kept of what it writes to stderr

std::vector<std::string> commandWords(const std::string& command) {
  std::vector<std::string> words;
  for (std::size_t begin = command.find_first_not_of(' '); begin != std::string::npos;) {
    const std::size_t end = std::min(command.find(' ', begin), command.size());
    words.push_back(command.substr(begin, end - begin));
    begin = command.find_first_not_of(' ', end);
  }
  return words;
}

/// The file that a program's name means: as it is with a slash, else in PATH; empty if it is not there. Relative
/// entries of PATH are left out: a file among the scans must not be run because the scans are in the current folder.
std::string programFile(const std::string& program) {
  if (program.find('/') != std::string::npos) return program;
  const char* const path = std::getenv("PATH");
  std::string_view folders = path != nullptr ? path : "";
  while (!folders.empty()) {
    const std::size_t end = std::min(folders.find(':'), folders.size());
    const std::string file = std::string(folders.substr(0, end)) + "/" + program;
    if (folders.front() == '/' && ::access(file.c_str(), X_OK) == 0) return file;
    folders.remove_prefix(std::min(end + 1, folders.size()));
  }
  return {};
}

/// What the command did wrong, to be completed with its name and the file's.
struct DecoderProblem : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// A process whose output and errors are read here; killed at the end if it still runs.
class Decoder {
 public:
  Decoder(const std::vector<std::string>& words, const std::string& file) {
    std::array<int, 2> out = {-1, -1}, errors = {-1, -1};
    int failure = 0;
    if (::pipe2(out.data(), O_CLOEXEC) != 0 || ::pipe2(errors.data(), O_CLOEXEC) != 0) {
      failure = errno;
    } else {
      failure = spawn(words, file, out[1], errors[1]);
    }
    for (const int end : {out[1], errors[1]})
      if (end >= 0) ::close(end);
    out_ = out[0];
    errors_ = errors[0];
    if (failure == 0) return;
    child_ = -1;
    closePipes();
    throw DecoderProblem(std::string("cannot be started: ") + std::strerror(failure));
  }
  ~Decoder() {
    if (child_ > 0) {
      ::kill(child_, SIGKILL);
      while (::waitpid(child_, nullptr, 0) < 0 && errno == EINTR) {
      }
    }
    closePipes();
  }
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;

  /// Reads until `wanted` bytes are there or the output ends. @throws DecoderProblem
  std::size_t read(char* to, std::size_t wanted) {
    std::size_t have = 0;
    while (have < wanted && !ended_) {
      std::array<pollfd, 2> ready = {{{out_, POLLIN, 0}, {errors_, POLLIN, 0}}};
      const int polled = ::poll(ready.data(), ready.size(), std::chrono::milliseconds(kSilence).count());
      if (polled < 0 && errno == EINTR) continue;
      if (polled <= 0) throw DecoderProblem("wrote nothing for " + std::to_string(kSilence.count()) + " s");
      if (ready[1].revents != 0) readErrors();
      if (ready[0].revents == 0) continue;
      const ssize_t n = ::read(out_, to + have, wanted - have);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) throw DecoderProblem(std::string("cannot be read: ") + std::strerror(errno));
      have += static_cast<std::size_t>(n);
      ended_ = n == 0;
    }
    return have;
  }

  /// Waits for the process. @return what is wrong, empty if nothing is
  std::string farewell() {
    if (child_ <= 0) return outcome_;
    const auto deadline = std::chrono::steady_clock::now() + kFarewell;
    int status = 0;
    for (;;) {
      readErrors();
      const pid_t gone = ::waitpid(child_, &status, WNOHANG);
      if (gone == child_) break;
      if (gone < 0 && errno != EINTR) return outcome_ = "is gone";
      if (std::chrono::steady_clock::now() > deadline) return outcome_ = "closed its output but did not end";
      std::this_thread::sleep_for(std::chrono::milliseconds(2));
    }
    child_ = -1;
    readErrors();
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return outcome_;
    outcome_ = WIFSIGNALED(status) ? "was ended by signal " + std::to_string(WTERMSIG(status))
                                   : "failed with exit code " + std::to_string(WEXITSTATUS(status));
    return outcome_ += lastErrorLine();
  }

 private:
  /// @return 0 or an errno
  int spawn(const std::vector<std::string>& words, const std::string& file, int out, int errors) {
    std::vector<char*> arguments;
    for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
    arguments.push_back(const_cast<char*>(file.c_str()));
    arguments.push_back(nullptr);
    posix_spawn_file_actions_t files;
    posix_spawnattr_t attributes;
    if (::posix_spawn_file_actions_init(&files) != 0) return ENOMEM;
    ::posix_spawn_file_actions_addopen(&files, 0, "/dev/null", O_RDONLY, 0);
    ::posix_spawn_file_actions_adddup2(&files, out, 1);
    ::posix_spawn_file_actions_adddup2(&files, errors, 2);
    ::posix_spawnattr_init(&attributes);
    // Signals that this program ignores or blocks would stay so in the command.
    sigset_t none, defaults;
    ::sigemptyset(&none);
    ::sigemptyset(&defaults);
    for (const int signal : {SIGPIPE, SIGINT, SIGTERM, SIGHUP}) ::sigaddset(&defaults, signal);
    ::posix_spawnattr_setsigmask(&attributes, &none);
    ::posix_spawnattr_setsigdefault(&attributes, &defaults);
    ::posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF);
    const std::string program = programFile(words.front());
    const int failure = program.empty()
                            ? ENOENT
                            : ::posix_spawn(&child_, program.c_str(), &files, &attributes, arguments.data(), environ);
    ::posix_spawnattr_destroy(&attributes);
    ::posix_spawn_file_actions_destroy(&files);
    return failure;
  }

  void readErrors() {
    std::array<char, 1024> block;
    for (;;) {
      pollfd ready = {errors_, POLLIN, 0};
      if (errors_ < 0 || ::poll(&ready, 1, 0) <= 0) return;
      const ssize_t n = ::read(errors_, block.data(), block.size());
      if (n <= 0) {
        ::close(errors_);
        errors_ = -1;
        return;
      }
      text_.append(block.data(), static_cast<std::size_t>(n));
      if (text_.size() > 2 * kErrorBytes) text_.erase(0, text_.size() - kErrorBytes);
    }
  }

  [[nodiscard]] std::string lastErrorLine() const {
    const std::size_t last = text_.find_last_not_of(" \t\r\n");
    if (last == std::string::npos) return "";
    const std::size_t before = text_.find_last_of("\r\n", last);
    const std::size_t first = before == std::string::npos ? 0 : before + 1;
    return ": " + forMessage(std::string_view(text_).substr(first, last + 1 - first), 256);
  }

  void closePipes() {
    for (int* const end : {&out_, &errors_}) {
      if (*end >= 0) ::close(*end);
      *end = -1;
    }
  }

  pid_t child_ = -1;
  int out_ = -1, errors_ = -1;
  bool ended_ = false;
  std::string text_, outcome_;
};

class DecoderSource final : public ByteSource {
 public:
  DecoderSource(const std::filesystem::path& path, const std::string& command)
      : path_(path), command_(command), words_(commandWords(command)) {
    if (words_.empty()) fail("is empty");
  }
  [[nodiscard]] std::optional<std::uint64_t> size() const override { return size_; }
  void checkAtEnd() override {
    // The first time to the end, reading what follows the points too, so that the command can end by itself.
    if (!decoder_ || (size_ && !ended_)) return;
    std::vector<char> rest(kDiscarded);
    while (!ended_) (void)fill(at_, rest.data(), rest.size());
    const std::string problem = decoder_->farewell();
    if (!problem.empty()) fail(problem);
  }

 private:
  static constexpr std::size_t kDiscarded = std::size_t{1} << 16;

  std::size_t fill(std::uint64_t offset, char* to, std::size_t wanted) override {
    if (wanted == 0) return 0;
    try {
      if (!decoder_ || offset < at_) start();
      while (at_ < offset && !ended_) {
        const auto skip = static_cast<std::size_t>(std::min<std::uint64_t>(offset - at_, kDiscarded));
        discarded_.resize(kDiscarded);
        (void)take(discarded_.data(), skip);
      }
      return at_ < offset ? 0 : take(to, wanted);
    } catch (const DecoderProblem& problem) {
      fail(problem.what());
    }
  }
  void start() {
    const std::string& name = path_.native();
    decoder_.reset();
    decoder_ = std::make_unique<Decoder>(words_, name.front() == '-' ? "./" + name : name);
    at_ = 0;
    ended_ = false;
  }
  std::size_t take(char* to, std::size_t wanted) {
    const std::size_t have = decoder_->read(to, wanted);
    at_ += have;
    if (have == wanted) return have;
    ended_ = true;
    if (size_ && *size_ != at_) {
      const std::string problem = decoder_->farewell();
      throw DecoderProblem(!problem.empty() ? problem
                                            : "wrote " + std::to_string(at_) + " bytes, but " + std::to_string(*size_) +
                                                  " the time before");
    }
    size_ = at_;
    return have;
  }
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError("input.decoder", forMessage(path_.native()),
                     "the decoder '" + forMessage(command_, 256) + "' " + problem,
                     "Try the command by hand, name another with laz_command, or convert the file to LAS");
  }

  std::filesystem::path path_;
  std::string command_;
  std::vector<std::string> words_;
  std::unique_ptr<Decoder> decoder_;
  std::vector<char> discarded_;
  std::uint64_t at_ = 0;  ///< bytes of the decoder's output so far
  bool ended_ = false;
  std::optional<std::uint64_t> size_;
};

}  // namespace

bool isInstalled(const std::string& program) { return !programFile(program).empty(); }

std::string findLazDecoder() {
  for (const char* const program : {"laszip", "las2las"})
    if (!programFile(program).empty()) return std::string(program) + " -stdout";
  return {};
}

std::unique_ptr<ByteSource> openDecoder(const std::filesystem::path& path, const std::string& command) {
  const InputDescriptor file(path);
  if (file.size() == 0)
    throw InputError("input.empty", forMessage(path.native()), "is empty (0 bytes)", "Copy the file again");
  std::array<char, kLfsPointer.size()> beginning;
  const std::size_t bytes = file.readAt(0, beginning.data(), beginning.size());
  refuseLfsPointer({beginning.data(), bytes}, forMessage(path.native()));
  return std::make_unique<DecoderSource>(path, command);
}

std::unique_ptr<ByteSource> openProgram(const std::string& argument, const std::string& command) {
  return std::make_unique<DecoderSource>(argument, command);
}

}  // namespace accessvdb::io
