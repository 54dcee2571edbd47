# cmake -DOUT=page_text.cpp -DHTML=FILE -DSTYLE=FILE -DSCRIPT="FILE;FILE ..." -P accessvdb_page_text.cmake
# Makes the source file that holds the page of src/report/page as three texts.
set(_delimiter accessvdb)

function(append_text name files)
  set(_text "")
  foreach(_file IN LISTS files)
    file(READ "${_file}" _part)
    string(APPEND _text "${_part}")
  endforeach()
  if(_text MATCHES "\\)${_delimiter}\"")
    message(FATAL_ERROR "${files}: contains what ends the text in C++")
  endif()
  file(APPEND "${OUT}" "extern const std::string_view ${name};\nconst std::string_view ${name} = R\"${_delimiter}(${_text})${_delimiter}\";\n")
endfunction()

file(WRITE "${OUT}" "// Made by cmake/accessvdb_page_text.cmake from src/report/page.\n#include <string_view>\n\nnamespace accessvdb::internal {\n")
append_text(kPageHtml "${HTML}")
append_text(kPageStyle "${STYLE}")
append_text(kPageScript "${SCRIPT}")
file(APPEND "${OUT}" "}  // namespace accessvdb::internal\n")
