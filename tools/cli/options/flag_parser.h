// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// The flags of one verb: their names, where their values go, and the text of --help. CLI11 does the work in
/// flag_parser.cpp; no other file includes it, since that costs 8 seconds of compile time per file.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace accessvdb::tools {

/// Between the values of a flag that is given several times. Not a line end, which may be in the name of a file.
inline constexpr char kBetweenValues = '\x1f';

class FlagParser {
 public:
  explicit FlagParser(std::string program = "accessvdb");
  ~FlagParser();

  /// Where the value of a flag goes. What it holds when the flag is added is the default, which --help shows.
  using Target = std::variant<std::string*, int*, double*, std::uint64_t*, std::optional<int>*, std::optional<double>*>;

  /// Name of the verb, what it does, and examples, for --help and messages.
  void describe(const std::string& verb, const std::string& purpose, const std::string& example);
  /// "--name" takes one value; a name without dashes takes its place on the command line.
  void option(const std::string& name, Target value, const std::string& help);
  /// May be given several times: the value has kBetweenValues between two texts. In a file of settings, an array.
  void repeated(const std::string& name, std::string* value, const std::string& help);
  /// May be given several times; with a separator also as one text: "a,b".
  void list(const std::string& name, std::vector<std::string>& values, const std::string& help,
            std::optional<char> separator = std::nullopt);
  /// Takes no value.
  void flag(const std::string& name, bool& value, const std::string& help);

  [[nodiscard]] const std::string& verb() const { return verb_; }
  [[nodiscard]] std::string command() const { return program_ + " " + verb_; }  ///< the program and its verb
  [[nodiscard]] std::string help() const;
  /// @return false if --help was given  @throws InvalidArgument ("usage.option")
  [[nodiscard]] bool parse(const std::vector<std::string>& arguments);

  /// Whether repeated() added it.
  [[nodiscard]] bool repeats(const std::string& key) const;
  [[nodiscard]] bool has(const std::string& key) const;    ///< key: the name without dashes
  [[nodiscard]] bool isSet(const std::string& key) const;  ///< by parse() or set()
  /// @return what is wrong with the text, if anything  @pre has(key)
  [[nodiscard]] std::optional<std::string> set(const std::string& key, const std::string& text);

  struct Setting {
    std::string key;
    std::variant<bool, std::string> value;  ///< bool for a flag without a value; the text may be empty
  };
  [[nodiscard]] std::vector<Setting> settings() const;  ///< of all flags with dashes

 private:
  struct Parser;
  std::unique_ptr<Parser> parser_;
  std::string program_, verb_;
};

}  // namespace accessvdb::tools
