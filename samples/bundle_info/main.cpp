// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// Prints a fixture bundle as JSON, the same values as `vfplan info --json`.
#include <cstring>
#include <iostream>
#include <string>
#include <vector>

#include "json.hpp"
#include "vfplan/bundle/fixture.hpp"

int main(int argc, char** argv) {
    std::vector<std::string> words(argv + 1, argv + argc);
    const bool values = std::erase(words, "--values") > 0;
    if (words.size() != 1) {
        std::cerr << "usage: bundle_info FIXTURE.h5 [--values]\n";
        return 2;
    }
    try {
        auto data = vfplan::bundle::read_file(words[0]);
        JsonWriter(std::cout, values).write(vfplan::bundle::read_bundle(data));
    } catch (const vfplan::bundle::BundleError& error) {
        std::cout << "{\"error\": {\"kind\": " << JsonWriter::string(error.kind())
                  << ", \"message\": " << JsonWriter::string(error.what())
                  << ", \"where\": " << JsonWriter::string(error.where) << "}}\n";
        std::cerr << words[0] << ": " << error.what() << "\n";
        return error.kind() == "InputError" ? 3 : 4;
    }
    return 0;
}
