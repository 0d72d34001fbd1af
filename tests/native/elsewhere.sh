#!/bin/sh
# The engine elsewhere: for aarch64 it must give the bits that it gives here, on every scene and by
# every rule, and so must a build for Windows that Wine runs.
#
#   tests/native/elsewhere.sh [TICKS=500]
#
# colcon also builds it as a package of ROS 2, Conan as its own with the samples beside it, and
# rattler-build reads the recipe for conda (a build needs conda-forge's packages).
#
# Debian, Ubuntu: apt install g++-aarch64-linux-gnu qemu-user g++-mingw-w64-x86-64-posix wine wine64
#                             ament-cmake colcon python3-colcon-ros
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
ticks=${1:-500}
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
build() {
    compiler=$1 && shift
    "$compiler" -std=c++20 -O1 -ffp-contract=off -Wall -Wextra -Wpedantic -Werror "$@" \
        -I"$root/vfplan/native/include" "$root/tests/native/engine_bits.cpp"
}
build aarch64-linux-gnu-g++ -static -o "$folder/arm" &
arm=$!
build x86_64-w64-mingw32-g++-posix -DVFPLAN_NARROW -static -o "$folder/windows.exe"
wait $arm
build g++ -DVFPLAN_NARROW -o "$folder/here"
"$folder/here" "$ticks" >"$folder/here.txt"
qemu-aarch64 "$folder/arm" "$ticks" | diff "$folder/here.txt" -
export WINEPREFIX="$folder/wine" WINEDEBUG=-all
wine "$folder/windows.exe" "$ticks" 2>/dev/null | tr -d '\r' | diff "$folder/here.txt" -
wineserver -w
mkdir "$folder/ws"
cp -r "$root/vfplan/native" "$folder/ws/vfplan"
(cd "$folder/ws" && PATH=/usr/bin:/bin colcon build --event-handlers console_direct- --cmake-args \
    -DVFPLAN_AMENT=ON -DPython3_EXECUTABLE=/usr/bin/python3 -DCMAKE_CXX_FLAGS=-DVFPLAN_NARROW)
test -f "$folder/ws/install/vfplan/share/vfplan/cmake/vfplanConfig.cmake"
python3 -m venv "$folder/tools"
"$folder/tools/bin/pip" install -q conan==2.34.0 py-rattler-build==0.73.0
export CONAN_HOME="$folder/conan"
conan="$folder/tools/bin/conan"
"$conan" profile detect >/dev/null 2>&1
printf 'include(default)\n[settings]\ncompiler.cppstd=20\n[platform_requires]\nopenssl/%s\n' \
    "$(openssl version | cut -d' ' -f2)" >"$folder/profile"
cp -r "$root/release" "$root/samples" "$folder"
mkdir "$folder/vfplan" && cp -r "$root/vfplan/native" "$folder/vfplan"
"$conan" create "$folder/release/conan" -pr "$folder/profile" >"$folder/conan.txt" 2>&1 || { cat "$folder/conan.txt"; exit 1; }
grep -q '^proxy' "$folder/conan.txt"
"$folder/tools/bin/python" - "$root" <<'END'
# The recipe asks for what pyproject.toml asks for, in conda-forge's names.
import sys, tomllib
from pathlib import Path
from rattler_build import Stage0Recipe, VariantConfig

root = Path(sys.argv[1])
variants = VariantConfig.from_yaml("c_stdlib: [sysroot]\nc_stdlib_version: ['2.28']\n")
[rendered] = Stage0Recipe.from_file(root / "release/conda/recipe.yaml").render(variants)
wanted = tomllib.loads((root / "pyproject.toml").read_text())["project"]
names = {"opencv-contrib-python-headless": "py-opencv", "matplotlib": "matplotlib-base", "vtk": "vtk-base"}
asked = ["python" + wanted["requires-python"], *wanted["dependencies"]]
for there, here in names.items():
    asked = [line.replace(there + ">", here + ">") for line in asked]
got = [line.replace(" ", "") for line in rendered.recipe.to_dict()["requirements"]["run"]]
assert sorted(got) == sorted(asked), (got, asked)
END
echo "$(wc -l <"$folder/here.txt") scenes and rules: the same bits on aarch64 and, under Wine, on Windows; built by colcon and by Conan, read by rattler-build"
