"""The samples find the package as CMake finds it, compile against it and run."""

from pathlib import Path

from conan import ConanFile
from conan.tools.build import can_run
from conan.tools.cmake import CMake, cmake_layout


class Samples(ConanFile):
    """Programs that ask for vfplan by Conan."""

    settings = "os", "arch", "compiler", "build_type"
    generators = "CMakeDeps", "CMakeToolchain"

    def requirements(self):
        """The package that was just made."""
        self.requires(self.tested_reference_str)

    def layout(self):
        """As CMake projects lie."""
        cmake_layout(self)

    def build(self):
        """The numbered samples, against the package alone."""
        cmake = CMake(self)
        cmake.configure(build_script_folder="../../../samples")
        cmake.build()

    def test(self):
        """The first of them presses three points."""
        if can_run(self):
            self.run(str(Path(self.build_folder) / "01_press"), env="conanrun")
