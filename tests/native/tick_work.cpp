// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// One call makes an engine of a fixture; by a second word, offline.

#include <iostream>

#include "vfplan/bundle/engine.hpp"

int main(int argc, char** argv) {
    try {
        const auto fixture = vfplan::bundle::read_fixture(argv[1]);
        if (argc > 2) {
            vfplan::Engine engine(fixture, vfplan::Rule::robust, vfplan::Use::offline);
            return engine.planar() ? 1 : 0;
        }
        vfplan::Engine engine(fixture);
        if (engine.distance({{1e-3, 5e-4, 0}}) == 0) std::cout << "by its triangles";
        const vfplan::Step s = engine.step({{0.4, 0, 0.1}});
        return s.status & vfplan::Status::bad_hip ? 1 : 0;
    } catch (const std::exception& error) {
        std::cout << error.what();
        return 2;
    }
}
