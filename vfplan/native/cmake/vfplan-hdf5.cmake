# Target vfplan::hdf5, the bundle reader: looked for only when asked for, by
#   find_package(vfplan COMPONENTS hdf5)      or     -DVFPLAN_HDF5=ON with add_subdirectory
# Needs libhdf5 >= 1.10.5 with its "high level" part and OpenSSL's libcrypto >= 1.1.1
# (Debian, Ubuntu: apt install libhdf5-dev libssl-dev).
include(CMakeFindDependencyMacro)
if(NOT CMAKE_C_COMPILER_LOADED)
  enable_language(C) # CMake's own search for HDF5 compiles C
endif()
find_dependency(HDF5 COMPONENTS C HL)
find_dependency(OpenSSL 1.1.1 COMPONENTS Crypto)
if(NOT TARGET vfplan::hdf5)
  add_library(vfplan::hdf5 INTERFACE IMPORTED)
  target_link_libraries(vfplan::hdf5 INTERFACE vfplan::vfplan hdf5::hdf5 hdf5::hdf5_hl
                                               OpenSSL::Crypto)
endif()
set(vfplan_hdf5_FOUND TRUE)
