# Target vfplan::vfplan, the compiled library, built in this project. An installed vfplan has it
# ready; the Python package has its source, vfplan/engine.cpp. With OpenSSL it checks signatures.
if(NOT TARGET vfplan_library)
  find_package(OpenSSL 1.1.1 QUIET COMPONENTS Crypto)
  add_library(vfplan_library STATIC EXCLUDE_FROM_ALL "${VFPLAN_INCLUDE_DIR}/vfplan/engine.cpp")
  add_library(vfplan::vfplan ALIAS vfplan_library)
  target_link_libraries(vfplan_library PUBLIC vfplan::includes)
  target_compile_definitions(vfplan_library PUBLIC VFPLAN_COMPILED)
  # Controller and replay must agree bit for bit: no contraction to fused multiply-add.
  target_compile_options(vfplan_library
                         PRIVATE $<$<CXX_COMPILER_ID:GNU,Clang,AppleClang>:-ffp-contract=off>)
  if(OPENSSL_FOUND)
    target_link_libraries(vfplan_library PRIVATE OpenSSL::Crypto)
    target_compile_definitions(vfplan_library PRIVATE VFPLAN_SIGNED)
  endif()
  set_target_properties(vfplan_library PROPERTIES POSITION_INDEPENDENT_CODE ON OUTPUT_NAME vfplan
                                                  EXPORT_NAME vfplan)
  if(NOT CMAKE_BUILD_TYPE AND NOT CMAKE_CONFIGURATION_TYPES)
    target_compile_options(vfplan_library PRIVATE -O2)
  endif()
endif()
