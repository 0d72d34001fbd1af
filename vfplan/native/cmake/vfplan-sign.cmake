# Target vfplan::sign, for who reads signatures by headers alone (vfplan/bundle/trust.hpp): asked for by
#   find_package(vfplan COMPONENTS sign)      or     -DVFPLAN_SIGN=ON with add_subdirectory
# Needs OpenSSL's libcrypto >= 1.1.1 (Debian, Ubuntu: apt install libssl-dev).
include(CMakeFindDependencyMacro)
find_dependency(OpenSSL 1.1.1 COMPONENTS Crypto)
if(NOT TARGET vfplan::sign)
  add_library(vfplan::sign INTERFACE IMPORTED)
  target_link_libraries(vfplan::sign INTERFACE vfplan::headers OpenSSL::Crypto)
  target_compile_definitions(vfplan::sign INTERFACE VFPLAN_SIGNED)
endif()
set(vfplan_sign_FOUND TRUE)
