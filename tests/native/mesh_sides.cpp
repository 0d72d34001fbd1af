// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
//   mesh_sides < numbers    whether places lie in the body of which a closed mesh is the skin
//
// Reads how many points, triangles and places there are, then all of them, and prints a line with
// 1, in the body, or 0 for each place.
#include <iostream>

#include "vfplan/mesh/exact.hpp"

int main() {
    std::size_t n, k, places;
    std::cin >> n >> k >> places;
    std::vector<double> points(3 * n);
    std::vector<std::int32_t> triangles(3 * k);
    for (double& x : points) std::cin >> x;
    for (std::int32_t& row : triangles) std::cin >> row;
    const vfplan::mesh::Mesh mesh({points.data(), n, triangles.data(), k});
    vfplan::mesh::BodySearch body(&mesh);
    vfplan::WorkBudget budget;
    for (std::size_t i = 0; i < places; ++i) {
        vfplan::Vec3 y;
        for (double& x : y.c) std::cin >> x;
        std::optional<bool> is_in;
        while (!is_in) {
            budget.begin(100);
            is_in = body.is_inside(y, 0, budget);
        }
        std::cout << *is_in << '\n';
    }
}
