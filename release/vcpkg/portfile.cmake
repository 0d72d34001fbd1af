# An overlay port of this repository: vcpkg install vfplan --overlay-ports=release/vcpkg
vcpkg_cmake_configure(SOURCE_PATH "${CURRENT_PORT_DIR}/../../vfplan/native")
vcpkg_cmake_install()
vcpkg_cmake_config_fixup(CONFIG_PATH share/cmake/vfplan)
vcpkg_fixup_pkgconfig()
file(REMOVE_RECURSE "${CURRENT_PACKAGES_DIR}/debug/include" "${CURRENT_PACKAGES_DIR}/debug/share")
vcpkg_install_copyright(FILE_LIST "${CURRENT_PORT_DIR}/../../LICENSE")
