# Of the package that ament_cmake makes: its targets are those of vfplan's own configuration.
include("${CMAKE_CURRENT_LIST_DIR}/../../cmake/vfplan/vfplan-config.cmake")
