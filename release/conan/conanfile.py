"""The C++ library as a Conan 2 package: `conan create release/conan` in a clone."""

from pathlib import Path

from conan import ConanFile
from conan.tools.build import check_min_cppstd
from conan.tools.cmake import CMake, cmake_layout
from conan.tools.files import copy


class Vfplan(ConanFile):
    """Virtual fixtures from bundles, at 1 kHz."""

    name = "vfplan"
    version = "1.0.0"
    license = "BSD-3-Clause"
    package_type = "static-library"
    settings = "os", "arch", "compiler", "build_type"
    generators = "CMakeDeps", "CMakeToolchain"
    requires = "openssl/[>=1.1.1]"

    def export_sources(self):
        """The native folder, from the clone that holds this file."""
        native = Path(self.recipe_folder).parents[1] / "vfplan" / "native"
        copy(self, "*", native, self.export_sources_folder)

    def validate(self):
        """The headers are C++20, so the user's profile must be too."""
        check_min_cppstd(self, 20)

    def layout(self):
        """As CMake projects lie."""
        cmake_layout(self)

    def build(self):
        """The compiled library."""
        cmake = CMake(self)
        cmake.configure()
        cmake.build()

    def package(self):
        """Headers, library and CMake's package file."""
        CMake(self).install()

    def package_info(self):
        """CMake finds the package's own file: targets, C++20 and OpenSSL as without Conan."""
        self.cpp_info.set_property("cmake_find_mode", "none")
        self.cpp_info.builddirs = ["share/cmake/vfplan"]
