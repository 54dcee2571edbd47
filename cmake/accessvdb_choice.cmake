# accessvdb_choice(NAME WHAT FOUND): an option that is AUTO (if FOUND), ON or OFF. A macro: it sets the variable where it is
# called.
macro(accessvdb_choice name what found)
  set(${name} AUTO CACHE STRING "${what}: AUTO (if ${found}), ON or OFF")
  set_property(CACHE ${name} PROPERTY STRINGS AUTO ON OFF)
  if(NOT ${name} MATCHES "^(AUTO|ON|OFF)$")
    message(FATAL_ERROR "${name} is '${${name}}'. Use AUTO (if ${found}), ON or OFF.")
  endif()
endmacro()
