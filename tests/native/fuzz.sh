#!/bin/sh
# Fuzzes the bundle reader with libFuzzer and the sanitizers of addresses and undefined behaviour.
#
#   tests/native/fuzz.sh [SECONDS=60] [FOLDER=build/fuzz]
#
# Needs clang with its runtime (Debian, Ubuntu: apt install clang libclang-rt-14-dev, or the
# version of your clang). FOLDER keeps the corpus from run to run; it begins with the archived
# bundles. A failing input is left there as crash-*, and the exit status is that of libFuzzer.
set -eu
root=$(cd "$(dirname "$0")/../.." && pwd)
seconds=${1:-60}
folder=${2:-$root/build/fuzz}
mkdir -p "$folder/corpus"
for file in "$root"/tests/data/bundles/2.*.h5; do
    # The payload alone: an archived bundle's seal has 512 bytes.
    head -c -512 "$file" >"$folder/corpus/$(basename "$file").payload"
done
clang++ -std=c++20 -O1 -g -fsanitize=fuzzer,address,undefined -fno-sanitize-recover=undefined \
    -I"$root/vfplan/native/include" "$root/tests/native/fuzz_bundle.cpp" -o "$folder/fuzz_bundle"
"$folder/fuzz_bundle" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=512 -max_len=65536 \
    -artifact_prefix="$folder/" "$folder/corpus"
