#!/bin/sh
# The engine elsewhere: for aarch64 it must give the bits that it gives here, on every scene and by
# every rule, and so must a build for Windows that Wine runs.
#
#   tests/native/elsewhere.sh [TICKS=500]
#
# colcon also builds it as a package of ROS 2.
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
echo "$(wc -l <"$folder/here.txt") scenes and rules: the same bits on aarch64 and, under Wine, on Windows; built by colcon"
