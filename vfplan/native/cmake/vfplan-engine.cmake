# Target vfplan::engine: the rules compiled once, as a static library, for programs of several source
# files. It gives the same bits as the headers alone. Asked for by
#   find_package(vfplan COMPONENTS engine)      or     -DVFPLAN_ENGINE=ON with add_subdirectory
if(NOT TARGET vfplan_engine)
  add_library(vfplan_engine STATIC EXCLUDE_FROM_ALL "${VFPLAN_INCLUDE_DIR}/vfplan/engine.cpp")
  target_link_libraries(vfplan_engine PUBLIC vfplan::vfplan)
  target_compile_definitions(vfplan_engine PUBLIC VFPLAN_COMPILED)
  set_target_properties(vfplan_engine PROPERTIES POSITION_INDEPENDENT_CODE ON)
  add_library(vfplan::engine ALIAS vfplan_engine)
endif()
set(vfplan_engine_FOUND TRUE)
