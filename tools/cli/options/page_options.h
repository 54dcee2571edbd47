// Copyright Contributors to the AccessVDB project
// SPDX-License-Identifier: Apache-2.0
/// What stands at the top of a page.
#pragma once

#include <string>

#include "options/flag_parser.h"

namespace accessvdb::tools {

struct PageHeader {
  std::string title, client, site;
};
/// @param otherwise  what the page is called without --title
inline void addPageHeader(FlagParser& flags, PageHeader& header, const std::string& otherwise) {
  flags.option("--title", &header.title, "what the page is called; default: " + otherwise);
  flags.option("--client", &header.client, "for whom it is");
  flags.option("--site", &header.site, "of which place");
}

}  // namespace accessvdb::tools
