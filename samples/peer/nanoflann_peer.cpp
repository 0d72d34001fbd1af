// Copyright (c) 2026, the vfplan authors. BSD-3-Clause.
//
// What a user would build without vfplan: nanoflann's k-d tree finds the neighbours, the paper's
// Algorithms 1-4 move the proxy. A peer for `vfplan bench --peer`. With the word "penalty" before
// the folder it pushes away from the nearest point instead, and remembers nothing.
//
//     apt install libnanoflann-dev
//     g++ -std=c++20 -O2 -o nanoflann_peer nanoflann_peer.cpp
//     vfplan bench proxy --peer ./nanoflann_peer -o DIR
//
// Called with a folder: reads points.csv, path.csv and settings.csv there, writes proxies.csv.
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <fstream>
#include <iostream>
#include <limits>
#include <map>
#include <nanoflann.hpp>
#include <sstream>
#include <string>
#include <vector>

using Vec = std::array<double, 3>;

static Vec operator-(const Vec& a, const Vec& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
static Vec operator+(const Vec& a, const Vec& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
static Vec operator*(double s, const Vec& a) { return {s * a[0], s * a[1], s * a[2]}; }
static double dot(const Vec& a, const Vec& b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static double norm(const Vec& a) { return std::sqrt(dot(a, a)); }

struct Cloud {
    std::vector<Vec> points;
    size_t kdtree_get_point_count() const { return points.size(); }
    double kdtree_get_pt(size_t i, size_t k) const { return points[i][k]; }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};
using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud,
                                                 3, size_t>;

static std::vector<Vec> read_rows(const std::string& path) {
    std::ifstream file(path);
    if (!file) throw std::runtime_error("cannot open " + path);
    std::vector<Vec> rows;
    std::string line;
    std::getline(file, line);  // the header
    while (std::getline(file, line)) {
        std::replace(line.begin(), line.end(), ',', ' ');
        std::istringstream in(line);
        Vec v;
        if (in >> v[0] >> v[1] >> v[2]) rows.push_back(v);
    }
    return rows;
}

static std::map<std::string, double> read_settings(const std::string& path) {
    std::ifstream file(path);
    if (!file) throw std::runtime_error("cannot open " + path);
    std::map<std::string, double> settings;
    std::string line;
    std::getline(file, line);
    while (std::getline(file, line)) {
        const auto comma = line.find(',');
        if (comma != std::string::npos)
            settings[line.substr(0, comma)] = std::stod(line.substr(comma + 1));
    }
    return settings;
}

#if NANOFLANN_VERSION >= 0x150
using Found = nanoflann::ResultItem<size_t, double>;
static nanoflann::SearchParameters unsorted() { return {0.0F, false}; }
#else
using Found = std::pair<size_t, double>;
static nanoflann::SearchParams unsorted() { return {0, 0.0F, false}; }
#endif

class PaperRule {
  public:
    PaperRule(const Cloud& cloud, std::map<std::string, double> s)
        : cloud_(cloud),
          tree_(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(10)),
          rc_(s.at("contact_radius")),
          r1_(rc_ - s.at("band")),
          r2_(rc_ + s.at("band")),
          r3_(s.at("outer_radius")),
          rv_(s.at("point_radius")),
          xi_(s.at("gain")) {
        tree_.buildIndex();
    }

    void step(Vec& proxy, const Vec& hip) {
        near_.clear();
        const double reach = r3_ + rv_;
        tree_.radiusSearch(proxy.data(), reach * reach, near_, unsorted());  // radii are squared
        const Vec u = hip - proxy;
        if (near_.empty()) {
            proxy = hip;
            return;
        }
        bool entrenched = false, contact = false;
        Vec sum{};
        double weights = 0;
        for (const auto& [i, square] : near_) {
            const double r = std::sqrt(square);
            entrenched |= r < r1_ + rv_;
            contact |= r >= r1_ + rv_ && r <= r2_ + rv_;
            if (r == 0) continue;
            const double t = std::clamp((r - r1_) / (r3_ - r1_), 0.0, 1.0);
            const double w = (1 + 4 * t) * std::pow(1 - t, 4);
            sum = sum + (w / r) * (proxy - cloud_.points[i]);
            weights += w;
        }
        const double length = norm(sum);
        const Vec n = length > 1e-12 * weights ? (1 / length) * sum : Vec{};
        if (entrenched)
            leave(proxy, n);
        else if (contact)
            slide(proxy, u, n);
        else
            approach(proxy, hip, u, n);
    }

  private:
    static Vec along(const Vec& v, double d) {
        const double length = norm(v);
        return length > 0 ? (d / length) * v : Vec{};
    }

    void leave(Vec& proxy, const Vec& n) const {  // Algorithm 4, eq. (7)
        double d = -std::numeric_limits<double>::infinity();
        for (const auto& [i, square] : near_) {
            if (std::sqrt(square) >= r1_ + rv_) continue;
            const Vec w = cloud_.points[i] - proxy;
            const double ahead = dot(w, n), R = rc_ + rv_;
            d = std::max(d, ahead + std::sqrt(ahead * ahead + R * R - square));
        }
        proxy = proxy + d * n;
    }

    void slide(Vec& proxy, const Vec& u, const Vec& n) const {  // Algorithm 3, eq. (4)-(6)
        const Vec up = u - dot(n, u) * n;
        const double d = xi_ * std::min(norm(up), r1_);
        proxy = proxy + along(dot(n, u) < 0 ? up : u, d);
    }

    void approach(Vec& proxy, const Vec& hip, const Vec& u, const Vec& n) const {  // Algorithm 2
        const double length = norm(u), R = rc_ + rv_;
        if (length == 0) return;
        const Vec ray = (1 / length) * u;
        double d = length, to_hip = 0, to_proxy = 0;
        for (const auto& [i, square] : near_) {
            const Vec w = cloud_.points[i] - proxy;
            to_proxy += std::sqrt(square);
            to_hip += norm(cloud_.points[i] - hip);
            const double ahead = dot(w, ray), disc = ahead * ahead - square + R * R;
            if (disc < 0) continue;
            const double root = ahead - std::sqrt(disc);
            if (root >= 0) d = std::min(d, root);
        }
        const bool inside = dot(n, u) < 0;
        Vec s = d * ray;
        if (d == 0 && inside) {  // special case 1
            const Vec up = u - dot(n, u) * n;
            s = along(up, xi_ * std::min(norm(up), r1_));
        }
        if (!inside && to_hip > to_proxy) s = u;  // special case 2
        proxy = proxy + s;
    }

    const Cloud& cloud_;
    Tree tree_;
    double rc_, r1_, r2_, r3_, rv_, xi_;
    std::vector<Found> near_;
};

// The "proxy" of a penalty force is where that force would be zero: on the ball around the nearest
// point. Once the HIP has passed the cloud, it is pushed out on the other side.
class Penalty {
  public:
    Penalty(const Cloud& cloud, std::map<std::string, double> s)
        : cloud_(cloud),
          tree_(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(10)),
          radius_(s.at("contact_radius") + s.at("point_radius")) {
        tree_.buildIndex();
    }

    void step(Vec& proxy, const Vec& hip) const {
        size_t nearest = 0;
        double square = 0;
        tree_.knnSearch(hip.data(), 1, &nearest, &square);
        proxy = hip;
        const double distance = std::sqrt(square);
        if (distance > 0 && distance < radius_)
            proxy = hip + (radius_ / distance - 1) * (hip - cloud_.points[nearest]);
    }

  private:
    const Cloud& cloud_;
    Tree tree_;
    double radius_;
};

template <class Rule>
static bool render(Rule rule, const std::vector<Vec>& path, std::ofstream out) {
    out.precision(17);
    out << "x,y,z,us\n";
    Vec proxy = path.front();
    for (const Vec& hip : path) {
        const auto began = std::chrono::steady_clock::now();
        rule.step(proxy, hip);
        const std::chrono::duration<double, std::micro> took =
            std::chrono::steady_clock::now() - began;
        out << proxy[0] << ',' << proxy[1] << ',' << proxy[2] << ',' << took.count() << '\n';
    }
    return out.good();
}

int main(int argc, char** argv) try {
    const bool is_penalty = argc == 3 && std::string(argv[1]) == "penalty";
    if (argc != 2 && !is_penalty) {
        std::cerr << "usage: nanoflann_peer [penalty] FOLDER\n";
        return 2;
    }
    const std::string folder = std::string(argv[argc - 1]) + "/";
    const Cloud cloud{read_rows(folder + "points.csv")};
    const auto path = read_rows(folder + "path.csv");
    const auto settings = read_settings(folder + "settings.csv");
    if (path.empty()) throw std::runtime_error("the path is empty");

    std::ofstream out(folder + "proxies.csv");
    const bool written = is_penalty ? render(Penalty(cloud, settings), path, std::move(out))
                                    : render(PaperRule(cloud, settings), path, std::move(out));
    return written ? 0 : 1;
} catch (const std::exception& error) {
    std::cerr << error.what() << '\n';
    return 1;
}
